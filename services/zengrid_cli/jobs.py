"""Jobs of a sweep or a reproduction, done where it was asked for, with progress shown; Ctrl-C stops them safely."""

from __future__ import annotations

import argparse
import os
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

from zengrid_cli.options import parse_count

if TYPE_CHECKING:
    from zengrid.learn.sweep.job import Job

STOPPED = 130
"""Exit code after Ctrl-C."""


def add_options(it: argparse.ArgumentParser) -> None:
    """Where jobs are done, and what is shown."""
    where = it.add_mutually_exclusive_group()
    where.add_argument(
        "--jobs", type=parse_count, default=os.cpu_count() or 1, metavar="N",
        help="processes on this machine (default: its processors, %(default)s)",
    )  # fmt: skip
    where.add_argument(
        "--cluster", metavar="ADDRESS", help="a Ray cluster instead: auto, HOST:6379 or ray://HOST:10001"
    )
    it.add_argument("--quiet", action="store_true", help="no progress")


def do(jobs: Sequence[Job], folder: Path, options: argparse.Namespace) -> bool:
    """Do jobs in ``folder``; returns whether all are done, which they are not after Ctrl-C."""
    from zengrid.learn.sweep.workers import work

    if not jobs:
        return True
    with _interruptible() as stop, _shown(jobs, options.quiet) as progress:
        if options.cluster:
            from zengrid.learn.sweep.cluster import work_on_cluster

            return work_on_cluster(jobs, folder, options.cluster, progress, stop)
        return work(jobs, folder, options.jobs, progress, stop)


@contextmanager
def _interruptible() -> Iterator[Callable[[], bool]]:
    """Ctrl-C and SIGTERM are remembered instead of ending the process."""
    stopping = False

    def stop(number: int, frame: FrameType | None) -> None:
        nonlocal stopping
        stopping = True

    before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: stopping
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def _shown(jobs: Sequence[Job], quiet: bool) -> Iterator[Callable[[Job, float], None]]:
    """A bar for each job that is being done and one for all; in a pipe, a line for each job that is done."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    console = Console(highlight=False)
    live, begun, done = console.is_terminal and not quiet, time.monotonic(), 0
    columns = (
        TextColumn("{task.description}"), BarColumn(bar_width=24), TextColumn("{task.percentage:3.0f} %"),
        TimeElapsedColumn(), TimeRemainingColumn(),
    )  # fmt: skip
    with Progress(*columns, console=console, disable=not live) as bars:
        whole = bars.add_task(f"{len(jobs)} jobs", total=sum(job.effort for job in jobs))
        tasks: dict[str, TaskID] = {}
        reached = dict.fromkeys((job.id for job in jobs), 0.0)

        def progress(job: Job, share: float) -> None:
            nonlocal done
            if job.id not in tasks:
                tasks[job.id] = bars.add_task(job.title, total=1.0)
            bars.update(tasks[job.id], completed=share)
            bars.advance(whole, (share - reached[job.id]) * job.effort)
            reached[job.id] = share
            if share >= 1.0:
                done += 1
                bars.update(tasks[job.id], visible=False)
                bars.update(whole, description=f"{done} of {len(jobs)} jobs")
                if not quiet:
                    told = f"{done:3} of {len(jobs)}  {time.monotonic() - begun:6.1f} s  {job.title}"
                    bars.console.print(told, markup=False, soft_wrap=True)

        yield progress
