"""What has to hold once the faults are over: the journal, resources over time, nothing left behind."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from endurance.observer import ObservedSlot, Sample
from zengrid.journal import Journal
from zengrid.journal.audit import audit

GROWTH_FACTOR, GROWTH = 1.15, 8.0
"""A process may take this much more in the last quarter than in the first: factor, and MiB or handles."""
EXPECTED_FILES = ("journal.db", "journal.db-wal", "journal.db-shm", "logs", "up.txt")


def check_journal(path: Path, published: Sequence[ObservedSlot]) -> tuple[int, list[str]]:
    """Audit the journal, by itself and against what was published.

    Returns
    -------
    slots, findings:
        Number of slots in the journal, and a line for each thing wrong.
    """
    with Journal.open(path, read_only=True) as journal:
        findings = [] if len(journal.runs()) == 1 else [f"the journal holds {len(journal.runs())} runs, not 1"]
        run = journal.run()
        findings += audit(run)
        settled = {}
        for block in run.blocks(homes=False):
            columns = (block[name].tolist() for name in ("position", "buy_price", "demand_kw"))
            settled.update({int(p): (price, demand) for p, price, demand in zip(*columns, strict=True)})
    for slot in published:
        if settled.get(slot.position) != (slot.buy_price, slot.demand_kw):
            findings.append(f"slot {slot.position} was published as {slot}, not as settled")
    return len(settled), findings


def check_growth(samples: Mapping[str, Sequence[Sample]]) -> tuple[list[dict[str, Any]], list[str]]:
    """Compare what each process took in the first and in the last quarter of the run.

    Returns
    -------
    rows, findings:
        A row for each process, and a line for each that grew.
    """
    rows, findings = [], []
    end = max((taken[-1].at for taken in samples.values()), default=0.0)
    begin = min((taken[0].at for taken in samples.values()), default=0.0)
    quarter = (end - begin) / 4
    for title, taken in sorted(samples.items()):
        first = [sample for sample in taken if sample.at <= begin + quarter]
        last = [sample for sample in taken if sample.at >= end - quarter]
        if not first or not last:
            continue
        row: dict[str, Any] = {"process": title, "samples": len(taken)}
        for what in ("memory_mb", "handles"):
            before, after = (statistics.median(getattr(sample, what) for sample in part) for part in (first, last))
            row |= {f"{what}_first": before, f"{what}_last": after}
            if after > before * GROWTH_FACTOR + GROWTH:
                findings.append(f"{title}: {what} grew from {before:.0f} to {after:.0f}")
        rows.append(row)
    return rows, findings


def check_files(folder: Path, journal: Path) -> list[str]:
    """A line for each file beside the journal and the logs, and for a write-ahead log that was not emptied."""
    findings = [f"file {path.name} is left" for path in folder.iterdir() if path.name not in EXPECTED_FILES]
    log = Path(f"{journal}-wal")
    if log.exists() and log.stat().st_size:
        findings.append(f"{log.name} is left with {log.stat().st_size} bytes")
    return findings
