"""The homes now: state of charge, power, bill, and the agent behind each."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Annotated, Literal

from fastapi import APIRouter, Path, Query
from pydantic import BaseModel, Field

from zengrid.wire.base import AgentId
from zengrid.wire.queries import Status
from zengrid_gateway.link import Link
from zengrid_gateway.problems import Problem, documented

router = APIRouter(tags=["prosumers"])


class Prosumer(BaseModel):
    """One home, and the agent that commands its battery."""

    id: str = Field(examples=["p1"])
    agent: str = Field(description="Its agent; a fleet's agent has many homes.", examples=["p1"])
    presence: Literal["present", "absent", "away"] = Field(
        description="present: waited for; absent: missed several deadlines; away: no process.", examples=["present"]
    )
    policy: str = Field(description="What decides.", examples=["conventional"])
    pv_rated_kw: float = Field(examples=[4.0])
    capacity_kwh: float = Field(examples=[6.0])
    soc: float = Field(description="State of charge [-].", examples=[0.45])
    battery_kw: float = Field(description="> 0 charges [kW].", examples=[-2.0])
    injection_kw: float = Field(description="At the meter, > 0 exports [kW].", examples=[1.7])
    pv_kw: float = Field(examples=[0.6])
    load_kw: float = Field(examples=[0.9])
    bill: float = Field(description="Since the start of the run [$].", examples=[3.21])
    baseline_bill: float = Field(description="The same without demand response [$].", examples=[5.4])
    acted: int = Field(description="Slots in which its agent's action counted.", examples=[71])
    fallbacks: int = Field(description="Slots in which the fallback was used.", examples=[1])
    last_cause: str = Field(description="Why it last fell back, or empty.", examples=["deadline"])


class Prosumers(BaseModel):
    """Some of the homes, in the market's order."""

    total: int = Field(description="Homes in the market.", examples=[3])
    next: int | None = Field(description="Ask again with this `offset` for more; null at the end.", examples=[None])
    prosumers: list[Prosumer]


@router.get("/v1/prosumers", responses=documented("market-away", "invalid"))
async def prosumers(
    link: Link,
    offset: Annotated[int, Query(ge=0, le=10**6, description="Homes to skip.")] = 0,
    limit: Annotated[int, Query(ge=1, le=1000, description="Most homes in the answer.")] = 100,
) -> Prosumers:
    """All homes now. At most half a second old."""
    status = await link.homes_status()
    total = 0 if status.homes is None else len(status.homes.homes)
    following = offset + limit
    return Prosumers(
        total=total,
        next=following if following < total else None,
        prosumers=list(_prosumers(status, range(offset, min(following, total)))),
    )


@router.get("/v1/prosumers/{id}", responses=documented("market-away", "not-found", "invalid"))
async def prosumer(link: Link, id: Annotated[AgentId, Path(examples=["p1"])]) -> Prosumer:
    """One home now."""
    status = await link.homes_status()
    ids = () if status.homes is None else status.homes.homes
    if id not in ids:
        known = ", ".join(ids[:10]) or "none"
        raise Problem(
            "not-found", f"prosumer = {id}: not in the market; it has {known}{', ...' if len(ids) > 10 else ''}"
        )
    return next(_prosumers(status, [ids.index(id)]))


def _prosumers(status: Status, chosen: Iterable[int]) -> Iterator[Prosumer]:
    homes = status.homes
    assert homes is not None
    agents = {agent.id: agent for agent in status.agents}
    for i in chosen:
        agent = agents[homes.agents[i]]
        yield Prosumer(
            id=homes.homes[i],
            agent=agent.id,
            presence=agent.presence,
            policy=agent.policy,
            pv_rated_kw=homes.pv_rated_kw[i],
            capacity_kwh=homes.capacity_kwh[i],
            soc=homes.soc[i],
            battery_kw=homes.battery_kw[i],
            injection_kw=homes.injection_kw[i],
            pv_kw=homes.pv_kw[i],
            load_kw=homes.load_kw[i],
            bill=homes.bill[i],
            baseline_bill=homes.baseline_bill[i],
            acted=agent.acted,
            fallbacks=agent.fallbacks,
            last_cause=agent.last_cause,
        )
