"""Jobs on processes of this machine: each does one after another, and stops when told or left alone."""

from __future__ import annotations

import multiprocessing
import signal
from collections import deque
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from zengrid.errors import PolicyError, ZengridError
from zengrid.learn.sweep.job import Job, Stop, do

Progress = Callable[[Job, float], None]
"""Told how far a job is, 0 to 1; 1 means done."""

LOOKS_S = 0.2
"""Longest time between two questions whether to stop. [s]"""
ENDS_S = 60.0
"""Longest time for the workers to write down where they are. [s]"""


def work(jobs: Sequence[Job], folder: Path, processes: int, progress: Progress, stop: Stop) -> bool:
    """Do jobs, each in a folder of its name; returns whether all are done.

    Raises
    ------
    PolicyError
        Where a job failed; what others had done by then is kept.
    """
    context = multiprocessing.get_context("spawn")
    waiting = deque(jobs)
    staff: dict[Connection, tuple[BaseProcess, Job]] = {}
    failed: str | None = None

    def give(pipe: Connection, process: BaseProcess) -> None:
        if waiting and failed is None:
            staff[pipe] = process, waiting.popleft()
            pipe.send(staff[pipe][1])
        else:
            pipe.close()  # nothing left: the process ends
            process.join()

    try:
        for _ in range(min(processes, len(waiting))):
            ours, theirs = context.Pipe()
            process: BaseProcess = context.Process(target=_serve, args=(theirs, folder), daemon=True)
            process.start()
            theirs.close()
            give(ours, process)
        while staff and failed is None and not stop():
            for pipe in wait(list(staff), LOOKS_S):
                assert isinstance(pipe, Connection)
                process, job = staff[pipe]
                try:
                    told: Any = pipe.recv()
                except (EOFError, ConnectionError):
                    process.join()
                    failed = f"{job.title}: its process ended with exit code {process.exitcode}"
                    del staff[pipe]
                    continue
                if isinstance(told, float):
                    progress(job, told)
                elif isinstance(told, str):
                    failed = f"{job.title}: {told}"
                elif told:
                    progress(job, 1.0)
                    del staff[pipe]
                    give(pipe, process)
    finally:
        _dismiss(staff)
    if failed is not None:
        raise PolicyError(failed)
    return not staff


def _dismiss(staff: dict[Connection, tuple[BaseProcess, Job]]) -> None:
    """Let trainings write down where they are; what keeps nothing is ended at once."""
    for pipe, (process, job) in staff.items():
        if job.kind == "train":
            pipe.close()
        else:
            process.terminate()
    for process, _ in staff.values():
        process.join(ENDS_S)
        if process.is_alive():
            process.kill()
            process.join()


def _serve(pipe: Connection, folder: Path) -> None:
    """A worker: jobs come through the pipe; its end means to stop."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all processes of a terminal; who started us decides

    def left() -> bool:
        return pipe.poll()  # nothing is sent while a job is done: there is only the pipe's end to read

    def report(share: float) -> None:
        try:
            pipe.send(share)
        except OSError:
            return  # closed between two questions

    while True:
        try:
            job: Job = pipe.recv()
            try:
                done: bool | str = do(job, folder / job.id, report, left)
            except ZengridError as error:
                done = str(error)
            pipe.send(done)
        except (EOFError, ConnectionError):
            return
        if done is not True:
            return
