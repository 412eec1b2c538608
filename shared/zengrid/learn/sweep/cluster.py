"""Jobs on a Ray cluster: each is sent as plain values, and its files come back."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from zengrid.errors import PolicyError, brief
from zengrid.learn.sweep.job import RESULT, Job, Stop, do
from zengrid.learn.sweep.workers import LOOKS_S, Progress


def work_on_cluster(jobs: Sequence[Job], folder: Path, address: str, progress: Progress, stop: Stop) -> bool:
    """Do jobs, one processor each, as many at once as the cluster has; returns whether all are done.

    The nodes need the same version of zengrid with its extra ``learn``, and no file system in common. A job that is
    stopped begins anew next time: its checkpoints stay on its node.

    Parameters
    ----------
    jobs, folder, progress, stop:
        As in ``zengrid.learn.sweep.workers.work``.
    address:
        Of the cluster: ``auto``, ``HOST:6379``, ``ray://HOST:10001``.
    """
    try:
        ray: Any = import_module("ray")
    except ImportError:
        raise PolicyError("ray is not installed; needed: pip install 'zengrid[cluster]'") from None
    try:
        ray.init(address=address, log_to_driver=False, logging_level="warning")
    except (ConnectionError, ValueError, RuntimeError) as error:
        raise PolicyError(f"cluster = {address}: cannot be reached ({error})") from None
    try:
        task = ray.remote(num_cpus=1, max_retries=2)(_do_away)
        waiting = {task.remote(job): job for job in jobs}
        while waiting and not stop():
            ready, _ = ray.wait(list(waiting), timeout=LOOKS_S)
            for reference in ready:
                job = waiting.pop(reference)
                try:
                    files = ray.get(reference)
                except ray.exceptions.RayError as error:
                    raise PolicyError(f"{job.title}: failed on the cluster: {error}") from None
                _keep(files, folder / job.id)
                progress(job, 1.0)
        for reference in waiting:
            ray.cancel(reference, force=True)
    finally:
        ray.shutdown()
    return not waiting


def _do_away(job: Job) -> dict[str, bytes]:
    """On a node: do a job, and hand over the files it left."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        do(job, folder, lambda share: None, lambda: False)
        return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def _keep(files: dict[str, bytes], folder: Path) -> None:
    """Write what a job left, its result last: what has a result is complete."""
    outside = next((name for name in files if Path(name).name != name), None)
    if outside is not None:
        raise PolicyError(f"file {brief(repr(outside))} came from the cluster: permitted are names without a folder")
    folder.mkdir(parents=True, exist_ok=True)
    for name in sorted(files, key=lambda name: name == RESULT):
        (folder / name).write_bytes(files[name])
