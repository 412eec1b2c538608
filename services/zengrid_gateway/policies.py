"""What decides, and what it would do: asked of the agent that plays it."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from typing import Annotated, Any, Literal, Self

from fastapi import APIRouter, Path
from pydantic import BaseModel, ConfigDict, Field, model_validator

from zengrid.bus.market_client import MarketClient
from zengrid.errors import BusError, RefusedError
from zengrid.wire.base import AgentId
from zengrid.wire.queries import AgentStatus, PolicyReply, PolicyRequest, Status
from zengrid_gateway.archive import Archive, ArchiveOf
from zengrid_gateway.bodies import BodyRoute
from zengrid_gateway.invalid import FieldError
from zengrid_gateway.link import Link, MarketLink
from zengrid_gateway.problems import Problem, documented
from zengrid_gateway.quantities import QuantityError, candidates, observations, present
from zengrid_gateway.shelf import Shelf, ShelfOf, answer, home_spec

ROWS = 10_000
"""Most observations in one question."""
BATCH_NUMBERS = 2000
"""Numbers in a message that fits one of Zenoh's batches of 64 KiB."""

router = APIRouter(tags=["policies"], route_class=BodyRoute)

Agent = Annotated[AgentId, Path(examples=["p1"])]
Number = Annotated[float, Field(ge=-1e9, le=1e9)]
Numbers = Annotated[list[Number], Field(min_length=1, max_length=ROWS, fail_fast=True)]
Rows = Annotated[
    list[Annotated[list[Number], Field(min_length=1, max_length=BATCH_NUMBERS, fail_fast=True)]],
    Field(min_length=1, max_length=ROWS, fail_fast=True),
]
"""Validation stops at the first wrong number: all of them may be wrong."""
ONE_OF_BOTH: list[Any] = [
    {"required": ["quantities"], "properties": {"quantities": {"type": "object"}}},
    {"required": ["observations"], "properties": {"observations": {"type": "array"}}},
]
"""In the schema, what the validation of a question says: one of the two, and the other left out or null."""
EXAMPLES: list[Any] = [
    {"quantities": {"soc": [0.1, 0.5, 0.9], "pv_kw": 2.5, "load_kw": 1.0, "buy_price": 0.07, "hour": 13}},
    {"observations": [[0.5, 2.5, 1.0, 0.07, -0.26, -0.97, 0.095]]},
]


class Playing(BaseModel):
    """An agent and what decides for it."""

    agent: str = Field(examples=["p1"])
    role: Literal["grid", "prosumer"]
    policy: str = Field(description="Name of what decides.", examples=["conventional"])
    presence: Literal["present", "absent", "away"] = Field(description="Whether it can be asked: not when away.")
    homes: int = Field(description="Homes it commands.", examples=[1])


class File(BaseModel):
    """A trained policy that the gateway can read."""

    name: str = Field(examples=["generic"])
    role: Literal["grid", "prosumer"]
    version: str = Field(examples=["a1b2c3d4"])
    observation: str = Field(examples=["public"])
    features: list[str] = Field(examples=[["soc", "pv_kw", "load_kw", "buy_price"]])
    homes: list[str] = Field(description="Whose networks it holds; empty where one serves all.")
    dt_h: float = Field(description="Length of the slots it was trained on [h].", examples=[1.0])


class Policies(BaseModel):
    """Every agent's policy, and the policy files of this gateway."""

    policies: list[Playing]
    files: list[File]


class PolicyDetails(Playing):
    """One policy, and what it would do now."""

    version: str = Field(examples=["1"])
    features: list[str] = Field(description="What it looks at, in order.", examples=[["soc", "pv_kw", "load_kw"]])
    levels: list[float] = Field(description="Actions that its Q-values stand for; empty where it has none.")
    now: dict[str, float] = Field(description="The quantities as they are.", examples=[{"soc": 0.45, "pv_kw": 0.6}])
    action: float = Field(description="What it would do now: battery power [kW] or buy price [$/kWh].", examples=[-2.0])


class PolicyQuestion(BaseModel):
    """What it is asked: quantities by name, or whole observations."""

    model_config = ConfigDict(
        strict=True,
        extra="forbid",
        allow_inf_nan=False,
        json_schema_extra={"examples": EXAMPLES, "oneOf": ONE_OF_BOTH},
    )

    quantities: dict[str, Number | Numbers] | None = Field(
        default=None,
        description="Numbers, or lists of one length; `hour` gives the time of day. What is left out is as it is now.",
    )
    observations: Rows | None = Field(default=None, description="Rows in the order of the policy's features.")
    home: AgentId | None = Field(default=None, description="Whose limits to use; null: the agent's first home.")

    @model_validator(mode="after")
    def _one_of_both(self) -> Self:
        if (self.quantities is None) == (self.observations is None):
            raise ValueError("quantities, observations: give one of the two")
        return self


@router.get("/v1/policies", responses=documented("market-away"))
async def policies(link: Link, shelf: ShelfOf) -> Policies:
    """What decides for each agent; and the files that answer where an agent is gone."""
    status = await link.known_status()
    files = [
        File(
            name=file.name,
            role=file.role,
            version=file.version,
            observation=file.observation,
            features=list(file.features),
            homes=list(file.homes),
            dt_h=file.dt_h,
        )
        for file in await asyncio.to_thread(shelf.files)
    ]
    return Policies(policies=[Playing(**_playing(agent)) for agent in status.agents], files=files)


@router.get(
    "/v1/policies/{agent}", responses=documented("market-away", "agent-away", "not-found", "refused", "invalid")
)
async def policy(link: Link, archive: ArchiveOf, shelf: ShelfOf, agent: Agent) -> PolicyDetails:
    """One policy: what it looks at, what it can do, and what it would do now."""
    status = await link.homes_status()
    known = _agent(status, agent)
    reply = await Asker(link, archive, shelf, known, None).probe(status)
    now = present(status, agent, None)
    names = [name for name in reply.features if name in now]
    return PolicyDetails(
        **_playing(known),
        version=reply.version,
        features=list(reply.features),
        levels=list(reply.levels),
        now={name: now[name] for name in [*names, "hour"]},
        action=reply.actions[0],
    )


@router.post(
    "/v1/policies/{agent}/query",
    responses=documented(
        "market-away", "agent-away", "not-found", "refused", "length-required", "too-large", "invalid"
    ),
)
async def query(link: Link, archive: ArchiveOf, shelf: ShelfOf, agent: Agent, question: PolicyQuestion) -> PolicyReply:
    """What the policy would do, row by row: actions, and Q-values where it has them. Changes nothing."""
    status = await link.homes_status()
    asker = Asker(link, archive, shelf, _agent(status, agent), question.home)
    if question.observations is not None:
        rows = tuple(tuple(row) for row in question.observations)
        return await asker.ask(rows)
    assert question.quantities is not None
    features = (await asker.probe(status)).features
    now = present(status, agent, question.home)
    try:
        rows = await asyncio.to_thread(observations, features, question.quantities, now)
    except QuantityError as error:
        wrong = FieldError(field=f"body.quantities.{error.name}", value=error.value, allowed=error.allowed)
        raise Problem("invalid", f"quantities.{error}", errors=[wrong]) from None
    return await asker.ask(rows)


def _playing(agent: AgentStatus) -> dict[str, Any]:
    return {
        "agent": agent.id,
        "role": agent.role,
        "policy": agent.policy,
        "presence": agent.presence,
        "homes": agent.homes,
    }


def _agent(status: Status, agent: str) -> AgentStatus:
    for known in status.agents:
        if known.id == agent:
            return known
    names = ", ".join(known.id for known in status.agents[:10])
    raise Problem("not-found", f"agent = {agent}: not in the market; it has {names}")


class Asker:
    """Asks one agent's policy: the agent itself, or where it is gone the file that it played."""

    def __init__(self, link: MarketLink, archive: Archive, shelf: Shelf, agent: AgentStatus, home: str | None) -> None:
        self._link = link
        self._archive = archive
        self._shelf = shelf
        self._agent = agent
        self._home = home

    async def probe(self, status: Status) -> PolicyReply:
        """Ask for one action now, with each set of features that the policy may want."""
        now = present(status, self._agent.id, self._home)
        refusal: RefusedError | Problem | None = None
        for features in candidates(status, self._agent.role):
            row = tuple(_value(name, now) for name in features)
            try:
                return await self.ask((row,))
            except (RefusedError, Problem) as error:
                if isinstance(error, Problem) and error.kind != "invalid":
                    raise
                refusal = refusal or error  # what the usual features meet is the real reason
        assert refusal is not None
        raise refusal

    async def ask(self, rows: tuple[tuple[float, ...], ...]) -> PolicyReply:
        """Ask the agent, or its file where it has gone, if only a moment ago."""
        if self._agent.presence == "away":
            return await self._ask_file(rows)
        try:
            return await self._ask_agent(rows)
        except BusError:
            return await self._ask_file(rows)

    async def _ask_agent(self, rows: tuple[tuple[float, ...], ...]) -> PolicyReply:
        """Portion by portion: the clock's session passes a message on at once only where it fits one batch."""
        portion = max(BATCH_NUMBERS // max(len(row) for row in rows), 1)
        replies = [
            await self._link.ask_agent(self._question(rows[start : start + portion]))
            for start in range(0, len(rows), portion)
        ]
        whole = replies[0]
        if len(replies) == 1:
            return whole
        q_values = None if whole.q_values is None else tuple(row for reply in replies for row in reply.q_values or ())
        actions = tuple(action for reply in replies for action in reply.actions)
        return whole.model_copy(update={"actions": actions, "q_values": q_values})

    def _question(self, rows: tuple[tuple[float, ...], ...]) -> Callable[[MarketClient], PolicyReply]:
        request = PolicyRequest(observations=rows, home=self._home)
        return lambda client: client.ask_policy(self._agent.id, request)

    async def _ask_file(self, rows: tuple[tuple[float, ...], ...]) -> PolicyReply:
        agent = self._agent
        file = await asyncio.to_thread(self._shelf.find, agent.policy)
        if file is None:
            played = f"it played {agent.policy}" if agent.policy else "it never had one"
            raise Problem(
                "agent-away", f"agent = {agent.id}: has no process, and no policy file here answers for it ({played})"
            )
        home = None
        if agent.role == "prosumer":
            home = await home_spec(self._link, self._archive, self._home or agent.id)
        return await asyncio.to_thread(answer, file, agent.id, home, rows)


def _value(name: str, now: dict[str, float]) -> float:
    angle = 2.0 * math.pi * now.get("hour", 0.0) / 24.0
    return {"time_sin": math.sin(angle), "time_cos": math.cos(angle)}.get(name, now.get(name, 0.0))
