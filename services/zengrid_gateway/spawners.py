"""Prosumers on request: their processes are started and ended by spawners, which the gateway asks over Zenoh."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Header, Path, Response
from pydantic import BaseModel, ConfigDict, Field

from zengrid.scenario import HomeSpec
from zengrid.scenario.home_spec import Printable
from zengrid.wire.base import AgentId
from zengrid.wire.spawner_queries import ProcessStatus, SpawnerStatus, SpawnRequest, StopRequest
from zengrid_gateway.access import OPERATE
from zengrid_gateway.bodies import BodyRoute
from zengrid_gateway.link import Link, MarketLink
from zengrid_gateway.problems import Problem, documented

router = APIRouter(tags=["prosumers"], route_class=BodyRoute)


EXAMPLES: list[Any] = [
    {"id": "p4", "pv_kw": 5, "battery": {"capacity_kwh": 10}},
    {
        "id": "p5",
        "pv_kw": 8,
        "battery": {"capacity_kwh": 13.5, "charge_max_kw": 5, "discharge_max_kw": 5, "charge_efficiency": 0.95},
        "load": {"scale": 0.5},
        "policy": "random",
    },
]


class NewProsumer(HomeSpec):
    """A home, as scenarios describe it, and what decides for it."""

    model_config = ConfigDict(json_schema_extra={"examples": EXAMPLES}, defer_build=False)

    policy: Printable = Field(default="trained", max_length=200, description="A policy that the spawner knows.")


class StartedProsumer(BaseModel):
    """A process that now speaks for a home."""

    spawner: str = Field(description="Who looks after it.", examples=["host1"])
    process: ProcessStatus


class Spawners(BaseModel):
    """Every spawner of this market."""

    spawners: list[SpawnerStatus]


@router.get("/v1/spawners", responses=documented("market-away"))
async def spawners(link: Link) -> Spawners:
    """Who can start prosumers, and which run there."""
    return Spawners(spawners=await link.ask_agent(lambda client: client.spawners()))


@router.post(
    "/v1/prosumers",
    status_code=201,
    responses=documented(
        "market-away", "no-spawner", "forbidden", "refused", "length-required", "too-large", "invalid"
    ),
    dependencies=[OPERATE],
)
async def start(
    link: Link,
    response: Response,
    prosumer: NewProsumer,
    idempotency_key: Annotated[
        Printable, Header(max_length=200, description="Chosen by the client: the same key again starts nothing again.")
    ] = "",
) -> StartedProsumer:
    """Add a home with a process of its own; it counts from the next slot on. Answers when it takes part."""
    home = HomeSpec.model_validate(prosumer.model_dump(exclude={"policy"}))
    request = SpawnRequest(home=home, policy=prosumer.policy, key=idempotency_key)
    chosen = await _choose(link, home.id, prosumer.policy)
    process = await link.ask_agent(lambda client: client.spawn(chosen, request))
    link.forget_homes()
    response.headers["location"] = f"/v1/prosumers/{home.id}"
    return StartedProsumer(spawner=chosen, process=process)


@router.delete(
    "/v1/prosumers/{id}",
    status_code=204,
    responses=documented("market-away", "forbidden", "not-found", "refused", "invalid"),
    dependencies=[OPERATE],
)
async def stop(link: Link, id: Annotated[AgentId, Path(examples=["p4"])]) -> None:
    """Take a home out of the market by ending its process, where a spawner has started it."""
    for spawner in await link.ask_agent(lambda client: client.spawners()):
        if any(process.id == id for process in spawner.processes):
            await _stop(link, spawner.spawner, id)
            return
    status = await link.homes_status()
    if status.homes is not None and id in status.homes.homes:
        raise Problem("refused", f"prosumer = {id}: no spawner has started its process; end it where it was started")
    raise Problem("not-found", f"prosumer = {id}: not in the market")


async def _stop(link: MarketLink, spawner: str, home: str) -> None:
    await link.ask_agent(lambda client: client.stop_process(spawner, StopRequest(id=home)))
    link.forget_homes()


async def _choose(link: MarketLink, home: str, policy: str) -> str:
    """The spawner that has this home already, else of those that know the policy the one with most room."""
    found = await link.ask_agent(lambda client: client.spawners())
    if not found:
        raise Problem("no-spawner", f"run {link.run}: has no spawner; start one with: zengrid spawner")
    for spawner in found:
        if any(process.id == home for process in spawner.processes):
            return spawner.spawner
    name = policy.partition(":")[0]
    return max(found, key=lambda spawner: (name in spawner.policies, _room(spawner))).spawner


def _room(spawner: SpawnerStatus) -> float:
    """Free share of what a spawner may have, of processes or memory, whichever is less. [-]"""
    return min(
        1.0 - len(spawner.processes) / max(spawner.limit, 1),
        1.0 - spawner.memory_mb / max(spawner.memory_limit_mb, 1.0),
    )
