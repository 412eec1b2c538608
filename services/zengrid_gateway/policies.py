"""What decides, and what it would do: asked of the agent that plays it."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, Self

from fastapi import APIRouter, Path
from pydantic import BaseModel, ConfigDict, Field, model_validator

from zengrid.errors import RefusedError
from zengrid.wire.base import AgentId
from zengrid.wire.requests import AgentStatus, PolicyReply, PolicyRequest, Status
from zengrid_gateway.link import Link, MarketLink
from zengrid_gateway.problems import FieldError, Problem, documented
from zengrid_gateway.quantities import ROWS, QuantityError, candidates, observations, present

BATCH_NUMBERS = 2000
"""Numbers in a message that fits one of Zenoh's batches of 64 KiB."""

router = APIRouter(tags=["policies"])

Agent = Annotated[AgentId, Path(examples=["p1"])]
Number = Annotated[float, Field(ge=-1e9, le=1e9)]
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


class Policies(BaseModel):
    """Every agent's policy."""

    policies: list[Playing]


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
        strict=True, extra="forbid", allow_inf_nan=False, json_schema_extra={"examples": EXAMPLES}
    )

    quantities: dict[str, Number | list[Number]] | None = Field(
        default=None,
        description="Numbers, or lists of one length; `hour` gives the time of day. What is left out is as it is now.",
    )
    observations: list[Annotated[list[Number], Field(min_length=1)]] | None = Field(
        default=None, min_length=1, max_length=ROWS, description="Rows in the order of the policy's features."
    )
    home: AgentId | None = Field(default=None, description="Whose limits to use; null: the agent's first home.")

    @model_validator(mode="after")
    def _one_of_both(self) -> Self:
        if (self.quantities is None) == (self.observations is None):
            raise ValueError("quantities, observations: give one of the two")
        return self


@router.get("/v1/policies", responses=documented("market-away"))
async def policies(link: Link) -> Policies:
    """What decides for each agent."""
    status = await link.known_status()
    return Policies(policies=[Playing(**_playing(agent)) for agent in status.agents])


@router.get(
    "/v1/policies/{agent}", responses=documented("market-away", "agent-away", "not-found", "refused", "invalid")
)
async def policy(link: Link, agent: Agent) -> PolicyDetails:
    """One policy: what it looks at, what it can do, and what it would do now."""
    status = await link.homes_status()
    known = _agent(status, agent)
    reply = await _probe(link, status, known, None)
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
async def query(link: Link, agent: Agent, question: PolicyQuestion) -> PolicyReply:
    """What the policy would do, row by row: actions, and Q-values where it has them. Changes nothing."""
    status = await link.homes_status()
    known = _agent(status, agent)
    if question.observations is not None:
        rows = tuple(tuple(row) for row in question.observations)
        return await _ask_all(link, known, rows, question.home)
    assert question.quantities is not None
    features = (await _probe(link, status, known, question.home)).features
    now = present(status, agent, question.home)
    try:
        rows = observations(features, question.quantities, now)
    except QuantityError as error:
        wrong = FieldError(field=f"body.quantities.{error.name}", value=str(error.value)[:200], allowed=error.allowed)
        raise Problem("invalid", f"quantities.{error}"[:500], errors=[wrong]) from None
    return await _ask_all(link, known, rows, question.home)


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


async def _probe(link: MarketLink, status: Status, agent: AgentStatus, home: str | None) -> PolicyReply:
    """Ask for one action now, with each set of features that the policy may want."""
    now = present(status, agent.id, home)
    refusal: RefusedError | None = None
    for features in candidates(status, agent.role):
        row = tuple(_value(name, now) for name in features)
        try:
            return await _ask(link, agent, PolicyRequest(observations=(row,), home=home))
        except RefusedError as error:
            refusal = refusal or error  # what the usual features meet is the real reason
    assert refusal is not None
    raise refusal


def _value(name: str, now: dict[str, float]) -> float:
    angle = 2.0 * math.pi * now.get("hour", 0.0) / 24.0
    return {"time_sin": math.sin(angle), "time_cos": math.cos(angle)}.get(name, now.get(name, 0.0))


async def _ask_all(
    link: MarketLink, agent: AgentStatus, rows: tuple[tuple[float, ...], ...], home: str | None
) -> PolicyReply:
    """Ask portion by portion: the clock's session passes a message on at once only where it fits one batch."""
    portion = max(BATCH_NUMBERS // max(len(row) for row in rows), 1)
    replies = [
        await _ask(link, agent, PolicyRequest(observations=rows[start : start + portion], home=home))
        for start in range(0, len(rows), portion)
    ]
    whole = replies[0]
    if len(replies) == 1:
        return whole
    q_values = None if whole.q_values is None else tuple(row for reply in replies for row in reply.q_values or ())
    actions = tuple(action for reply in replies for action in reply.actions)
    return whole.model_copy(update={"actions": actions, "q_values": q_values})


async def _ask(link: MarketLink, agent: AgentStatus, wish: PolicyRequest) -> PolicyReply:
    if agent.presence == "away":
        raise Problem("agent-away", f"agent = {agent.id}: has no process that could answer")
    return await link.ask(lambda client: client.ask_policy(agent.id, wish))
