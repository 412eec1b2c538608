"""Runs the jobs of a sweep or a reproduction, with progress in the terminal; Ctrl-C stops them safely."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from zengrid.learn.sweep.job import Job
from zengrid.learn.sweep.workers import work
from zengrid_cli.training.stop_on_signal import stop_on_signal


def run_jobs(jobs: Sequence[Job], folder: Path, options: argparse.Namespace) -> bool:
    """Run jobs in ``folder``; return whether all are done, which they are not after Ctrl-C."""
    if not jobs:
        return True
    with stop_on_signal() as stopping, _show_progress(jobs, options.quiet) as on_progress:
        if options.cluster:
            from zengrid.learn.sweep.cluster import work_on_cluster  # needs the extra cluster

            return work_on_cluster(jobs, folder, options.cluster, on_progress, stopping)
        return work(jobs, folder, options.jobs, on_progress, stopping)


@contextmanager
def _show_progress(jobs: Sequence[Job], quiet: bool) -> Iterator[Callable[[Job, float], None]]:
    """Show a bar for each running job and one for all; where there is no terminal, a line for each finished job."""
    console = Console(highlight=False)
    live, started, done = console.is_terminal and not quiet, time.monotonic(), 0
    columns = (
        TextColumn("{task.description}"), BarColumn(bar_width=24), TextColumn("{task.percentage:3.0f} %"),
        TimeElapsedColumn(), TimeRemainingColumn(),
    )  # fmt: skip
    with Progress(*columns, console=console, disable=not live) as bars:
        whole = bars.add_task(f"{len(jobs)} jobs", total=sum(job.effort for job in jobs))
        tasks: dict[str, TaskID] = {}
        reached = dict.fromkeys((job.id for job in jobs), 0.0)

        def on_progress(job: Job, share: float) -> None:
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
                    line = f"{done:3} of {len(jobs)}  {time.monotonic() - started:6.1f} s  {job.title}"
                    bars.console.print(line, markup=False, soft_wrap=True)

        yield on_progress
