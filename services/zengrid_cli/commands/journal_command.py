"""``zengrid journal``: verifies a journal, backs it up, and deletes old days."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from zengrid.command_line.command_parser import CommandParser
from zengrid.command_line.market_options import add_journal_option
from zengrid.command_line.value_parsers import WholeNumber
from zengrid.errors import EXIT_FAILED

if TYPE_CHECKING:
    from zengrid.journal import Journal


def parser() -> CommandParser:
    """Make the parser of the command line."""
    it = CommandParser(
        prog="zengrid journal",
        description="Look after a journal, also while its market runs.",
        examples=["zengrid journal verify", "zengrid journal backup copy.db", "zengrid journal prune --keep-days 30"],
    )
    commands = it.add_subparsers(dest="command", required=True, metavar="COMMAND")
    verify = commands.add_parser(
        "verify",
        help="check every slot",
        description="Check every slot: each is there once and in order, energy and money balance to 1e-9, and every "
        "battery stays within its limits. Exit code 0: no fault found; 1: faults found, one line each, or the journal "
        "cannot be opened.",
        examples=["zengrid journal verify --journal zengrid.db --json"],
    )
    backup = commands.add_parser(
        "backup",
        help="copy a journal into a new SQLite file",
        description="Copy a journal, as it is at this moment, into a new SQLite file; the market continues meanwhile. "
        "The copy is a journal like any other, whatever database the original uses. It is verified before it gets its "
        "name.",
        examples=["zengrid journal backup copy.db"],
    )
    prune = commands.add_parser(
        "prune",
        help="delete old days",
        description="Delete all but the last days of each run; the sums over the deleted slots are kept. Refused while "
        "a market writes to the same SQLite file: start that market with --keep-days instead. An SQLite file reuses "
        "the space; it becomes smaller only with --vacuum.",
        examples=["zengrid journal prune --keep-days 30 --vacuum"],
    )
    backup.add_argument("target", type=Path, metavar="FILE", help="the new SQLite file")
    prune.add_argument(
        "--keep-days", type=WholeNumber(1), metavar="N", required=True, help="number of days of each run to keep"
    )
    prune.add_argument("--vacuum", action="store_true", help="also return the space to the system")
    for command in (verify, backup, prune):
        add_journal_option(command)
        if command is not backup:
            command.add_argument("--run", metavar="NAME", help="one run, such as main-1 (default: all)")
        command.add_argument("--json", action="store_true", help="print the result as JSON")
    return it


def main(arguments: Sequence[str]) -> int:
    """Run one of the subcommands."""
    options = parser().parse_args(arguments)
    return {"verify": _verify, "backup": _backup, "prune": _prune}[options.command](options)


@contextmanager
def _open_existing(place: str, *, read_only: bool) -> Iterator[Journal]:
    """Open a journal that exists: opening for writing would create one."""
    from zengrid.journal import Journal

    if not read_only:
        Journal.open(place, read_only=True).close()
    with Journal.open(place, read_only=read_only) as journal:
        yield journal


def _print_result(result: dict[str, Any], lines: list[str], *, as_json: bool) -> None:
    """Print a result for people, or for programs."""
    print(json.dumps(result, indent=2) if as_json else "\n".join(lines))


def _run_names(journal: Journal, run: str | None) -> list[str]:
    return [info.name for info in journal.runs()] if run is None else [journal.run(run).name]


def _verify(options: argparse.Namespace) -> int:
    from zengrid.journal.audit import audit

    runs: list[dict[str, Any]] = []
    with _open_existing(options.journal, read_only=True) as journal:
        database = journal.check()
        for name in _run_names(journal, options.run):
            view = journal.run(name)
            kept_from, count = view.kept_from(), view.count()
            findings = audit(view)
            runs.append({"run": name, "slots": count, "kept_from": kept_from, "findings": findings})
    sound = not database and not any(each["findings"] for each in runs)
    lines = [f"database: {text}" for text in database]
    for each in runs:
        pruned = f", the first {each['kept_from']} of them pruned" if each["kept_from"] else ""
        verdict = f"{len(each['findings'])} findings" if each["findings"] else "sound"
        lines.append(f"{each['run']}: {each['slots']} slots{pruned}: {verdict}")
        lines += [f"  {text}" for text in each["findings"]]
    result = {"sound": sound, "database": database, "runs": runs}
    _print_result(result, lines or ["the journal has no runs"], as_json=options.json)
    return 0 if sound else EXIT_FAILED


def _backup(options: argparse.Namespace) -> int:
    from zengrid.journal.maintenance import backup
    from zengrid_cli.report.progress_bar import progress_bar

    target: Path = options.target
    with _open_existing(options.journal, read_only=True) as journal, progress_bar("slots copied") as on_progress:
        slots = backup(journal, target, progress=on_progress)
    size = target.stat().st_size
    lines = [f"{target}: {slots} slots, {size / 2**20:.1f} MiB, verified"]
    _print_result({"file": str(target), "slots": slots, "bytes": size}, lines, as_json=options.json)
    return 0


def _prune(options: argparse.Namespace) -> int:
    from zengrid.journal.maintenance import prune

    runs: list[dict[str, Any]] = []
    with _open_existing(options.journal, read_only=False) as journal, journal.alone():
        before = journal.size()
        for name in _run_names(journal, options.run):
            done = prune(journal, journal.run(name), options.keep_days)
            runs.append({"run": name, "slots": done.slots, "kept_from": done.kept_from, "rosters": done.rosters})
        if options.vacuum:
            journal.vacuum()
        after = journal.size()
    lines = [f"{each['run']}: {each['slots']} slots deleted, kept from position {each['kept_from']}" for each in runs]
    lines.append(f"{before / 2**20:.1f} MiB before, {after / 2**20:.1f} MiB now")
    _print_result({"runs": runs, "bytes_before": before, "bytes": after}, lines, as_json=options.json)
    return 0
