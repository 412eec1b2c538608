"""The runs of the journal, and the figures of each."""

from __future__ import annotations

import asyncio
from datetime import UTC, datetime
from typing import Annotated

from fastapi import APIRouter, Depends, Path
from pydantic import BaseModel, Field
from starlette.requests import HTTPConnection

from zengrid.journal import RunInfo, RunTotals, RunView
from zengrid_gateway.archive import ArchiveOf
from zengrid_gateway.kpis import Kpis, of_run, of_status
from zengrid_gateway.link import Link
from zengrid_gateway.problems import documented

router = APIRouter(tags=["runs"])


class Run(BaseModel):
    """A run of the journal."""

    name: str = Field(examples=["main-1"])
    seed: int = Field(examples=[0])
    dt_h: float = Field(description="Length of a slot [h].", examples=[1.0])
    version: str = Field(description="Of zengrid, when it began.", examples=["0.1.0"])
    started_at: datetime
    finished_at: datetime | None = Field(description="Null while it goes on, or can be resumed.")
    slots: int = Field(description="Settled slots.", examples=[168])

    @classmethod
    def of(cls, info: RunInfo) -> Run:
        """From the journal."""
        return cls(
            name=info.name,
            seed=info.seed,
            dt_h=info.dt_h,
            version=info.version,
            started_at=datetime.fromtimestamp(info.started_at, UTC),
            finished_at=None if info.finished_at is None else datetime.fromtimestamp(info.finished_at, UTC),
            slots=info.slots,
        )


class Runs(BaseModel):
    """Runs, oldest first."""

    runs: list[Run]


class Book:
    """The sums of the runs asked for last; one of them is added up at a time."""

    KEPT = 100

    def __init__(self) -> None:
        self.lock = asyncio.Lock()
        self._totals: dict[str, RunTotals] = {}

    def read(self, run: RunView) -> RunTotals:
        """Add up a run; only slots settled since the last call are read. Blocks the calling thread."""
        # Taken out first: if reading fails half-way, the next call starts from the journal's own sums.
        self._totals[run.name] = totals = run.totals(known=self._totals.pop(run.name, None))
        if len(self._totals) > self.KEPT:
            del self._totals[next(iter(self._totals))]
        return totals


async def _book(connection: HTTPConnection) -> Book:
    book: Book = connection.app.state.book
    return book


BookOf = Annotated[Book, Depends(_book)]
RunName = Annotated[str, Path(max_length=80, pattern=r"^[\w.-]+$", examples=["main-1"])]


@router.get("/v1/runs", responses=documented("journal-away", "not-found"))
async def runs(archive: ArchiveOf) -> Runs:
    """All runs of the journal."""
    return Runs(runs=[Run.of(info) for info in await archive.runs()])


@router.get("/v1/runs/{run}/kpis", responses=documented("journal-away", "not-found", "invalid"))
async def run_kpis(archive: ArchiveOf, book: BookOf, run: RunName) -> Kpis:
    """How a run of the journal fared beside the same days without demand response."""
    found = await archive.run(run)
    async with book.lock:
        return of_run(found.name, await asyncio.to_thread(book.read, found))


@router.get("/v1/kpis", responses=documented("market-away"))
async def kpis(link: Link) -> Kpis:
    """How the market fares now beside the same days without demand response."""
    return of_status(await link.homes_status())
