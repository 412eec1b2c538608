"""``zengrid journal``: verify a journal, back it up, delete old days."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from zengrid.errors import ZengridError

if TYPE_CHECKING:
    from zengrid.journal import Journal

app = typer.Typer(add_completion=False, no_args_is_help=True, help="Look after a journal, also while its market runs.")

Place = Annotated[str, typer.Option("--journal", metavar="FILE|URL", help="Where settled slots are kept.")]
Name = Annotated[str | None, typer.Option("--run", metavar="NAME", help="One run (default: all).")]
AsJson = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]


@contextmanager
def opened(place: str, command: str, *, read_only: bool) -> Iterator[Journal]:
    """A journal that exists; what goes wrong becomes one line and exit code 2."""
    from zengrid.journal import Journal

    try:
        if not read_only:
            # Whoever writes would create it.
            Journal.open(place, read_only=True).close()
        with Journal.open(place, read_only=read_only) as journal:
            yield journal
    except ZengridError as error:
        typer.echo(f"zengrid journal {command}: {error}", err=True)
        raise typer.Exit(2) from None


def report(result: dict[str, Any], lines: list[str], *, as_json: bool) -> None:
    """Print a result for people, or for programs."""
    typer.echo(json.dumps(result, indent=2) if as_json else "\n".join(lines))


@app.command()
def verify(journal: Place = "zengrid.db", run: Name = None, as_json: AsJson = False) -> None:
    """Check every slot: each once and in order, energy and money balanced to 1e-9, every battery within its bounds.

    Exit code 0: sound; 1: something is wrong, one line each; 2: it cannot be opened.
    """
    from zengrid.journal.audit import audit

    runs: list[dict[str, Any]] = []
    with opened(journal, "verify", read_only=True) as source:
        database = source.check()
        names = [info.name for info in source.runs()] if run is None else [source.run(run).name]
        for name in names:
            view = source.run(name)
            kept_from, count = view.kept_from(), view.count()
            findings = audit(view)
            runs.append({"run": name, "slots": count, "kept_from": kept_from, "findings": findings})
    sound = not database and not any(each["findings"] for each in runs)
    lines = [f"the database itself: {text}" for text in database]
    for each in runs:
        pruned = f", the first {each['kept_from']} of them pruned" if each["kept_from"] else ""
        verdict = f"{len(each['findings'])} findings" if each["findings"] else "sound"
        lines.append(f"{each['run']}: {each['slots']} slots{pruned}: {verdict}")
        lines += [f"  {text}" for text in each["findings"]]
    report({"sound": sound, "database": database, "runs": runs}, lines or ["no run"], as_json=as_json)
    if not sound:
        raise typer.Exit(1)


@app.command()
def backup(
    target: Annotated[Path, typer.Argument(metavar="FILE", help="A new SQLite file.")],
    journal: Place = "zengrid.db",
    as_json: AsJson = False,
) -> None:
    """Copy a journal, as it is at this moment, into a new SQLite file; the market goes on meanwhile.

    The copy is a journal like any other, whatever the database of the original. It is verified before it gets its name.
    """
    from zengrid.journal.maintenance import backup as copy

    with opened(journal, "backup", read_only=True) as source, progress("copied") as told:
        slots = copy(source, target, progress=told)
    size = target.stat().st_size
    lines = [f"{target}: {slots} slots, {size / 2**20:.1f} MiB, verified"]
    report({"file": str(target), "slots": slots, "bytes": size}, lines, as_json=as_json)


@app.command()
def prune(
    keep_days: Annotated[int, typer.Option(min=1, metavar="N", help="How many days of each run are kept.")],
    journal: Place = "zengrid.db",
    run: Name = None,
    vacuum: Annotated[bool, typer.Option("--vacuum", help="Also give the space back to the system.")] = False,
    as_json: AsJson = False,
) -> None:
    """Delete all but the last days of each run; what the deleted slots add up to is kept.

    Refused while a market writes to the same SQLite file: start that market with --keep-days instead. An SQLite file
    uses the space again; only --vacuum makes it smaller.
    """
    from zengrid.journal.maintenance import prune as delete

    runs: list[dict[str, Any]] = []
    with opened(journal, "prune", read_only=False) as source, source.alone():
        before = source.size()
        names = [info.name for info in source.runs()] if run is None else [source.run(run).name]
        for name in names:
            done = delete(source, source.run(name), keep_days)
            runs.append({"run": name, "slots": done.slots, "kept_from": done.kept_from, "rosters": done.rosters})
        if vacuum:
            source.vacuum()
        after = source.size()
    lines = [f"{each['run']}: {each['slots']} slots deleted, kept from position {each['kept_from']}" for each in runs]
    lines.append(f"{before / 2**20:.1f} MiB before, {after / 2**20:.1f} MiB now")
    report({"runs": runs, "bytes_before": before, "bytes": after}, lines, as_json=as_json)


@contextmanager
def progress(what: str) -> Iterator[Any]:
    """A bar on the terminal, while there is much to do."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(f"slots {what}", total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)
