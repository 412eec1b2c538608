"""``zengrid export``: writes a run of the journal as CSV or Parquet."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from zengrid.command_line.command_parser import CommandParser
from zengrid.command_line.market_options import add_journal_option


def parse_day_range(text: str) -> tuple[int, int | None]:
    """``2:5`` -> (2, 5), ``2:`` -> (2, None), ``:5`` -> (0, 5), ``2`` -> (2, 3)."""
    first, colon, until = text.partition(":")
    try:
        low = int(first or 0) if colon else int(first)
        high = (int(until) if until else None) if colon else low + 1
    except ValueError:
        low, high = -1, None
    if low < 0 or (high is not None and high <= low):
        raise argparse.ArgumentTypeError("permitted: A:B for day A up to but without day B, A:, :B, or one day")
    return low, high


def parser() -> CommandParser:
    """Make the parser of the command line."""
    it = CommandParser(
        prog="zengrid export",
        description="Write settled slots as tables, also while the market runs. The table slots has one row per slot, "
        "the table homes one row per home and slot; scenario.yaml is the scenario that the run began with.",
        examples=["zengrid export", "zengrid export --run main-1 --format parquet --days 0:7 --out week"],
    )
    add_journal_option(it)
    it.add_argument("--run", metavar="NAME", help="which run, such as main-1 (default: the latest)")
    it.add_argument("--format", choices=["csv", "parquet"], default="csv", help="kind of files")
    it.add_argument("--out", type=Path, metavar="FOLDER", help="where to write (default: a folder named as the run)")
    it.add_argument(
        "--days", type=parse_day_range, default=":", metavar="A:B", help="day A up to but without day B (default: all)"
    )
    it.add_argument(
        "--homes", action=argparse.BooleanOptionalAction, default=True, help="also write the table homes (default: do)"
    )
    return it


def main(arguments: Sequence[str]) -> int:
    """Write the files, and print their names and sizes."""
    options = parser().parse_args(arguments)
    from zengrid.journal import Journal
    from zengrid.journal.table_export import export
    from zengrid_cli.report.progress_bar import progress_bar

    with Journal.open(options.journal, read_only=True) as journal:
        run = journal.run(options.run)
        with progress_bar(f"{run.name}: slots") as on_progress:
            written = export(
                run, options.out or Path(run.name), options.format,
                homes=options.homes, days=options.days, progress=on_progress,
            )  # fmt: skip
    for path in written:
        print(f"{path}  {path.stat().st_size:,} bytes")
    return 0
