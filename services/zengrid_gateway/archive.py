"""Where settled slots are read from: the journal where the gateway may read it, else the market's clock."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Annotated, Any, Protocol, TypeVar

import numpy as np
from fastapi import Depends
from numpy.typing import NDArray
from starlette.requests import HTTPConnection

from zengrid.bus.market_client import MarketClient
from zengrid.errors import JournalError, JournalUnavailableError
from zengrid.journal import Block, Journal, RunInfo, RunView
from zengrid.wire.queries import Status
from zengrid.wire.slots import HomeColumns, SettledSlot
from zengrid_gateway.link import MarketLink
from zengrid_gateway.problems import Problem

T = TypeVar("T")

PORTION_VALUES = 50_000
"""Homes times slots that the clock is asked for at a time."""
PORTION_SLOTS = 1000

FIGURES = (
    "position", "day", "slot", "buy_price", "sell_price", "demand_kw", "export_kw", "curtailed_kwh", "unserved_kwh",
    "profit", "baseline_profit",
)  # fmt: skip
FACILITIES = ("facility_kw", "facility_cost", "baseline_facility_kw")
HOMES = (
    "soc", "battery_kw", "injection_kw", "pv_kw", "load_kw", "bill", "baseline_soc", "baseline_bill",
    "fallback",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Part:
    """Consecutive slots with the same homes: figures ``(slot,)``, arrays ``(slot, facility)`` and ``(slot, home)``."""

    homes: tuple[str, ...]
    columns: dict[str, NDArray[Any]]

    def __getitem__(self, column: str) -> NDArray[Any]:
        return self.columns[column]

    def __len__(self) -> int:
        return len(self.columns["position"])


class Past(Protocol):
    """A run as far as it is settled. Blocks the calling thread."""

    name: str
    dt_h: float
    longest: int
    """Most slots to read for one request."""

    def count(self) -> int:
        """Settled slots."""
        ...

    def homes(self) -> set[str]:
        """Homes that took part (as far as known)."""
        ...

    def parts(self, since: int, until: int, *, homes: bool) -> Iterator[Part]:
        """Slots from a position up to, without, another; with ``homes`` the arrays of homes, too."""
        ...


class JournalPast:
    """A run of the journal, of any age, whether or not its market is there."""

    longest = 100_000

    def __init__(self, run: RunView) -> None:
        self.run = run
        self.name, self.dt_h = run.name, run.info.dt_h

    def count(self) -> int:
        """Settled slots."""
        return self.run.count()

    def homes(self) -> set[str]:
        """All that ever took part."""
        return {home for _, roster in self.run.rosters() for home in roster.homes}

    def parts(self, since: int, until: int, *, homes: bool) -> Iterator[Part]:
        """As the journal holds them."""
        for block in self.run.blocks(since, until, homes=homes):
            yield _part(block, self.dt_h, homes)


class ClockPast:
    """The run of the market that is there, as its clock tells it."""

    longest = 10_000

    def __init__(self, client: MarketClient, status: Status, settled: int) -> None:
        self.name, self.dt_h = status.run, status.dt_h
        self._client = client
        self._settled = settled
        self._homes = max(0 if status.last is None else status.last.homes, 1)

    def count(self) -> int:
        """Settled slots."""
        return self._settled

    def homes(self) -> set[str]:
        """Those that take part now."""
        now = self._client.control("status").homes
        return set() if now is None else set(now.homes)

    def parts(self, since: int, until: int, *, homes: bool) -> Iterator[Part]:
        """Portion by portion, so that the clock is never busy with one question for long."""
        portion = max(min(PORTION_VALUES // self._homes, PORTION_SLOTS), 1) if homes else PORTION_SLOTS
        while since < until:
            reply = self._client.history(since, min(portion, until - since), homes=homes)
            if not reply.slots:
                return
            yield from _parts(reply.slots, homes)
            since = reply.next


class Archive:
    """Finds runs."""

    def __init__(self, link: MarketLink, journal: str | None) -> None:
        self._link = link
        self._place = journal
        self._journal: Journal | None = None
        self._opening = threading.Lock()

    async def current(self) -> Past:
        """The run of the market that is shown: now, or when it was last there."""
        if self._place is not None:
            infos = [info for info in await self.runs() if info.name.rpartition("-")[0] == self._link.run]
            if infos:
                return await self.past(infos[-1].name)
        status = await self._link.known_status()
        return ClockPast(self._link.check(), status, self._link.feed.position + 1)

    async def past(self, name: str | None) -> Past:
        """A run by its name in the journal; by default the current one."""
        return await self.current() if name is None else JournalPast(await self.run(name))

    async def run(self, name: str) -> RunView:
        """A run of the journal by its name."""
        try:
            return await self._read(lambda journal: journal.run(name))
        except JournalUnavailableError:
            raise
        except JournalError as error:
            raise Problem("not-found", f"run = {name}: {error}") from None

    async def runs(self) -> list[RunInfo]:
        """All runs of the journal, oldest first."""
        return await self._read(Journal.runs)

    async def _read(self, question: Callable[[Journal], T]) -> T:
        if self._place is None:
            raise Problem(
                "not-found", "run: the gateway was started without --journal, and knows the current run alone"
            )
        return await asyncio.to_thread(lambda: question(self._open()))

    def _open(self) -> Journal:
        # Not at the start: the clock may be about to make it.
        with self._opening:
            if self._journal is None:
                assert self._place is not None
                self._journal = Journal.open(self._place, read_only=True)
            return self._journal

    def close(self) -> None:
        """Close the journal."""
        if self._journal is not None:
            self._journal.close()


def _part(block: Block, dt_h: float, homes: bool) -> Part:
    columns = {
        name: block[name] for name in ("position", "day", "slot", "buy_price", "sell_price", "demand_kw", "export_kw")
    }
    columns |= {name: block[name] for name in ("profit", "baseline_profit", *FACILITIES)}
    columns["curtailed_kwh"] = (block["curtailed_kw"] + block["home_curtailed_kw"]) * dt_h
    columns["unserved_kwh"] = (block["unserved_kw"] + block["home_unserved_kw"]) * dt_h
    columns["grid_fallback"] = block["grid_fallback"].astype(np.bool_)
    if homes:
        columns |= {name: block[name] for name in HOMES}
    return Part(block.roster.homes, columns)


def _parts(slots: tuple[SettledSlot, ...], homes: bool) -> Iterator[Part]:
    """The clock's answer, cut wherever the homes change."""
    start = 0
    for end in range(1, len(slots) + 1):
        if end == len(slots) or _ids(slots[end]) != _ids(slots[start]):
            yield _columns(slots[start:end], homes)
            start = end


def _ids(slot: SettledSlot) -> tuple[str, ...]:
    return () if slot.detail is None else slot.detail.homes


def _columns(slots: tuple[SettledSlot, ...], homes: bool) -> Part:
    columns = {name: np.array([getattr(slot, name) for slot in slots]) for name in (*FIGURES, *FACILITIES)}
    columns["grid_fallback"] = np.array(["grid" in slot.fallback for slot in slots])
    details = [slot.detail for slot in slots if slot.detail is not None]
    if homes:
        columns |= {name: np.array([_of_homes(detail, name) for detail in details]) for name in HOMES}
    return Part(_ids(slots[0]), columns)


def _of_homes(detail: HomeColumns, name: str) -> NDArray[Any]:
    if name == "fallback":
        missed = set(detail.fallback)
        return np.array([home in missed for home in detail.homes])
    column: NDArray[Any] = getattr(detail, name)
    return column


async def _archive(connection: HTTPConnection) -> Archive:
    archive: Archive = connection.app.state.archive
    return archive


ArchiveOf = Annotated[Archive, Depends(_archive)]
"""The archive, for routes."""
