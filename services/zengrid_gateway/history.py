"""What was settled: of the market, and of one home."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Annotated, Any
from urllib.parse import urlencode

from fastapi import APIRouter, Path, Query, Request, Response
from pydantic import BaseModel, ConfigDict, Field

from zengrid.wire.base import AgentId
from zengrid_gateway.archive import ArchiveOf, Part, Past
from zengrid_gateway.invalid import FieldError
from zengrid_gateway.problems import Problem, documented
from zengrid_gateway.tables import (
    MEDIA_TYPES,
    Format,
    Resolution,
    Table,
    as_file,
    as_json,
    home_table,
    joined,
    market_table,
    resampled,
)

router = APIRouter(tags=["history"])

MAX_POSITION = 2**31 - 1


class Wanted(BaseModel):
    """Which slots, and how."""

    model_config = ConfigDict(extra="forbid")

    since: int | None = Field(None, ge=0, le=MAX_POSITION, description="First position in the journal; default 0.")
    until: int | None = Field(None, ge=0, le=MAX_POSITION, description="Position after the last; default: all.")
    day: int | None = Field(None, ge=0, le=10**6, description="Instead of positions: first day.")
    days: int = Field(1, ge=1, le=10**6, description="Number of days from `day` on.")
    resolution: Resolution = Field(
        "slot", description="A row a slot, hour or day: means of powers and prices, sums of energy and money."
    )
    limit: int = Field(1000, ge=1, le=10_000, description="Most rows; ask again from `next` for more.")
    format: Format = Field("json", description="CSV and Parquet are files, with the rows alone.")
    run: str | None = Field(None, max_length=80, description="A run of /v1/runs; default the current one.")


class MarketRow(BaseModel):
    """A slot (or hour, or day) of the market."""

    position: int = Field(description="Position of its first slot in the journal.", examples=[89])
    day: int = Field(examples=[3])
    slot: int = Field(examples=[17])
    hour: float = Field(description="Local time at its start [h].", examples=[17.0])
    buy_price: float = Field(description="[$/kWh]", examples=[0.07])
    sell_price: float = Field(description="[$/kWh]", examples=[0.095])
    demand_kw: float = Field(description="All that the grid sells [kW].", examples=[23.4])
    export_kw: float = Field(description="All that the homes export [kW].", examples=[3.1])
    base_kw: float = Field(description="Output of the first facility [kW].", examples=[20.0])
    reserve_kw: float = Field(description="Output of all other facilities [kW].", examples=[0.3])
    baseline_base_kw: float = Field(description="The same without demand response [kW].", examples=[20.0])
    baseline_reserve_kw: float = Field(description="The same without demand response [kW].", examples=[4.2])
    facility_cost: float = Field(description="[$]", examples=[0.71])
    curtailed_kwh: float = Field(description="Energy nobody could take [kWh].", examples=[0.0])
    unserved_kwh: float = Field(description="Demand nobody could meet [kWh].", examples=[0.0])
    profit: float = Field(description="Of the grid [$].", examples=[1.29])
    baseline_profit: float = Field(description="Without demand response [$].", examples=[0.88])
    grid_fallback: bool | int = Field(description="Whether (how often) the grid did not answer.", examples=[False])


class HomeRow(BaseModel):
    """A slot (or hour, or day) of one home."""

    position: int = Field(description="Position of its first slot in the journal.", examples=[89])
    day: int = Field(examples=[3])
    slot: int = Field(examples=[17])
    hour: float = Field(description="Local time at its start [h].", examples=[17.0])
    buy_price: float = Field(description="[$/kWh]", examples=[0.07])
    sell_price: float = Field(description="[$/kWh]", examples=[0.095])
    injection_kw: float = Field(description="At the meter, > 0 exported [kW].", examples=[1.7])
    soc: float = Field(description="State of charge at its end [-].", examples=[0.45])
    battery_kw: float = Field(description="> 0 charged [kW].", examples=[-2.0])
    pv_kw: float = Field(description="[kW]", examples=[0.6])
    load_kw: float = Field(description="[kW]", examples=[0.9])
    bill: float = Field(description="[$]", examples=[-0.12])
    baseline_soc: float = Field(description="The same without demand response [-].", examples=[0.9])
    baseline_bill: float = Field(description="Without demand response [$].", examples=[0.01])
    fallback: bool | int = Field(description="Whether (how often) the fallback was used.", examples=[False])


class Page(BaseModel):
    """Rows in order."""

    run: str = Field(examples=["main-1"])
    resolution: Resolution
    dt_h: float = Field(description="Length of a slot [h].", examples=[1.0])
    next: int = Field(description="Ask again with `since` set to this for what follows.", examples=[120])


class MarketHistory(Page):
    """The market, slot by slot."""

    rows: list[MarketRow]


class HomeHistory(Page):
    """One home, slot by slot."""

    rows: list[HomeRow]


_FILES: dict[str, Any] = {
    MEDIA_TYPES["csv"]: {
        "schema": {"type": "string"},
        "example": '"position","day","slot","hour","buy_price","sell_price"\n89,3,17,17,0.07,0.095\n',
    },
    MEDIA_TYPES["parquet"]: {"schema": {"type": "string", "format": "binary"}},
}
_ANSWERS: dict[int | str, dict[str, Any]] = {
    200: {"description": "JSON, CSV or Parquet", "content": _FILES},
    **documented("market-away", "journal-away", "not-found", "invalid"),
}


@router.get("/v1/history", response_model=MarketHistory, responses=_ANSWERS)
async def history(request: Request, archive: ArchiveOf, wanted: Annotated[Wanted, Query()]) -> Response:
    """Settled slots of the market. `Link: rel="next"` and `next` lead to what follows."""
    past = await archive.past(wanted.run)
    return await _answer(request, past, wanted, lambda part: market_table(part, past.dt_h))


@router.get("/v1/prosumers/{id}/history", response_model=HomeHistory, responses=_ANSWERS)
async def home_history(
    request: Request, archive: ArchiveOf, wanted: Annotated[Wanted, Query()], id: Annotated[AgentId, Path()]
) -> Response:
    """Settled slots of one home, as far as it took part, beside the same home without demand response."""
    past = await archive.past(wanted.run)
    return await _answer(request, past, wanted, lambda part: home_table(part, past.dt_h, id), id)


async def _answer(
    request: Request, past: Past, wanted: Wanted, table: Callable[[Part], Table], home: str | None = None
) -> Response:
    group = _slots_of(wanted.resolution, past.dt_h)
    since, until = _range(wanted, past.dt_h)
    limit = min(wanted.limit, max(past.longest // group, 1))

    def read() -> tuple[bytes, int, bool]:
        settled = past.count()
        last = max(min(settled, until, (since // group + limit) * group), since)
        found = resampled(joined(table(part) for part in past.parts(since, last, homes=home is not None)), group)
        if home is not None and not found and home not in past.homes():
            raise Problem("not-found", f"prosumer = {home}: never took part in run {past.name}")
        # An hour or a day that goes on comes again with the next page.
        following = last if last % group == 0 or last == until else max(last - last % group, since)
        if wanted.format == "json":
            head = {"run": past.name, "resolution": wanted.resolution, "dt_h": past.dt_h, "next": following}
            return as_json(head, found), following, following < min(settled, until)
        return as_file(found, wanted.format), following, following < min(settled, until)

    body, following, more = await asyncio.to_thread(read)
    headers = {}
    if more:
        query = wanted.model_dump(exclude_none=True, exclude_defaults=True, exclude={"day", "days"})
        query |= {"since": following} | ({"until": until} if until < MAX_POSITION else {})
        headers["link"] = f'<{request.scope["path"]}?{urlencode(query)}>; rel="next"'
    if wanted.format != "json":
        headers["content-disposition"] = (
            f'attachment; filename="{past.name}-{home or "market"}-{since}.{wanted.format}"'
        )
    return Response(body, headers=headers, media_type=MEDIA_TYPES[wanted.format])


def _slots_of(resolution: Resolution, dt_h: float) -> int:
    """Slots a row stands for."""
    hours = {"slot": dt_h, "hour": 1.0, "day": 24.0}[resolution]
    return max(round(hours / dt_h), 1)


def _range(wanted: Wanted, dt_h: float) -> tuple[int, int]:
    """First position, and the one after the last."""
    if wanted.day is None:
        return wanted.since or 0, MAX_POSITION if wanted.until is None else wanted.until
    for name in ("since", "until"):
        value = getattr(wanted, name)
        if value is not None:
            error = FieldError(
                field=f"query.{name}", value=value, allowed="not beside day: give either days or positions"
            )
            raise Problem("invalid", f"{name} = {value}: {error.allowed}", errors=[error])
    slots_per_day = _slots_of("day", dt_h)
    return wanted.day * slots_per_day, (wanted.day + wanted.days) * slots_per_day
