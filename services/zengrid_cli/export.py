"""``zengrid export``: a run of the journal as CSV or Parquet."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from zengrid.errors import ZengridError


class Format(StrEnum):
    """Kinds of files."""

    CSV = "csv"
    PARQUET = "parquet"


def days_of(text: str) -> tuple[int, int | None]:
    """``2:5`` -> (2, 5), ``2:`` -> (2, None), ``:5`` -> (0, 5), ``2`` -> (2, 3)."""
    first, colon, until = text.partition(":")
    try:
        low = int(first or 0) if colon else int(first)
        high = (int(until) if until else None) if colon else low + 1
    except ValueError:
        low, high = -1, None
    if low < 0 or (high is not None and high <= low):
        raise typer.BadParameter(f"{text!r}: give a:b for the days from a up to, without, b; a: or :b, or one day")
    return low, high


def export(
    journal: Annotated[str, typer.Option(metavar="FILE|URL", help="Where settled slots are kept.")] = "zengrid.db",
    run: Annotated[str | None, typer.Option(metavar="NAME", help="Which run (default: the latest).")] = None,
    format: Annotated[Format, typer.Option(help="Kind of files.")] = Format.CSV,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Where to (default: a folder named as the run).")
    ] = None,
    days: Annotated[str, typer.Option(metavar="A:B", help="Days from A up to, without, B.")] = ":",
    homes: Annotated[bool, typer.Option(help="Also one row a home and slot.")] = True,
) -> None:
    """Write settled slots as tables, also while the market runs.

    slots has one row a slot, homes one row a home and slot, scenario.yaml is what the run began with.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    from zengrid.journal import Journal
    from zengrid.journal.table_export import export as write

    span = days_of(days)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    try:
        with Journal.open(journal, read_only=True) as opened:
            source = opened.run(run)
            with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
                task = progress.add_task(f"{source.name}: slots", total=None)
                written = write(
                    source,
                    out or Path(source.name),
                    format.value,
                    homes=homes,
                    days=span,
                    progress=lambda done, total: progress.update(task, completed=done, total=total),
                )
    except ZengridError as error:
        typer.echo(f"zengrid export: {error}", err=True)
        raise typer.Exit(1) from None
    for path in written:
        typer.echo(f"{path}  {path.stat().st_size:,} bytes")
