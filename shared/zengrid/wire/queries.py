"""Questions and answers: joining, leaving, control, status, history, and asking a policy."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from zengrid.scenario.home_spec import HomeSpec, Printable, home_columns
from zengrid.wire.base import MAX_HOMES, AgentId, Column, Instance, Message, Price, RunName
from zengrid.wire.slots import SettledSlot

RefusalReason = Literal["invalid", "taken", "full", "unknown", "not_yours", "ended", "unavailable"]
Speed = Annotated[
    float, Field(ge=0, le=1e9, description="Times faster than real time; 0 means as fast as answers come.")
]


class Refusal(Message):
    """Sent as a Zenoh error reply: why a request was not granted."""

    reason: RefusalReason
    message: str = Field(description="What was wrong, with which value, and what is allowed.")


class JoinRequest(Message):
    """A process takes over the agent of that name, or brings new homes with it."""

    agent: AgentId
    role: Literal["grid", "prosumer"]
    instance: Instance
    policy: Printable = Field(default="", max_length=200, description="Name of what decides, for display.")
    homes: Annotated[tuple[HomeSpec, ...], Field(fail_fast=True, max_length=MAX_HOMES)] | None = Field(
        default=None, description="Homes to add; null takes over the homes that the scenario gives this agent."
    )
    unclaimed: bool = Field(
        default=False,
        description="Play any unclaimed agent of the scenario, that is one without a process. If there is none, bring "
        "`homes` (at most one) under the name `agent`, with a number appended if that is taken. The reply says which.",
    )
    observation: Literal["paper", "public"] = "public"
    encoding: Literal["json", "binary"] = "json"


class HomeLimits(Message):
    """What an agent must know of a home to command its battery."""

    id: AgentId
    pv_kw: float = Field(description="Rated PV power [kW].")
    capacity_kwh: float
    charge_max_kw: float
    discharge_max_kw: float
    soc_min: float
    soc_max: float
    charge_efficiency: float
    discharge_efficiency: float
    injection_max_kw: float
    soc_initial: float

    @classmethod
    def of(cls, home: HomeSpec) -> HomeLimits:
        """The limits of a home as its scenario or agent describes it."""
        return cls.model_validate({"id": home.id, "pv_kw": home.pv_kw, **home_columns(home)})


class JoinReply(Message):
    """The market an agent has joined, and the slot from which it counts."""

    run: RunName
    scenario: str
    agent: AgentId
    brought: bool = Field(description="Whether its homes came with it, and leave with it; otherwise they stay.")
    day: int
    slot: int
    slots_per_day: int
    dt_h: float = Field(gt=0)
    deadline_s: float = Field(description="Time to answer a phase [s]; shorter where the market is paced.")
    buy_prices: tuple[Price, ...] = Field(description="Levels the grid may set [$/kWh].")
    battery_levels: int = Field(description="Number of command levels a learner uses between its limits.")
    sell_prices: tuple[Price, ...] = Field(description="Posted tariff, one a slot of the day [$/kWh].")
    baseline_buy_price: Price = Field(description="Buy price without demand response [$/kWh].")
    soc_reset: Literal["daily", "never"]
    facilities: int
    homes: tuple[HomeLimits, ...] = Field(description="The agent's homes, in the order of all columns.")


class LeaveRequest(Message):
    """Takes an agent and its homes out of the market from the next slot on."""

    agent: AgentId
    instance: Instance


class LeaveReply(Message):
    """The first slot without the homes."""

    day: int
    slot: int


class ControlRequest(Message):
    """What an operator may ask the clock."""

    command: Literal["pause", "resume", "step", "speed", "stop", "status"]
    slots: int = Field(default=1, ge=1, le=1_000_000, description="For `step`: slots to run before pausing again.")
    speed: Speed | None = Field(default=None, description="For `speed`.")
    homes: bool = Field(default=True, description="Whether the answer lists the homes.")


class AgentStatus(Message):
    """One agent as the clock sees it."""

    id: AgentId
    role: Literal["grid", "prosumer"]
    presence: Literal["present", "absent", "away"] = Field(
        description="present: waited for; absent: missed deadlines, served but not waited for; away: no process."
    )
    policy: str
    homes: int
    acted: int = Field(description="Slots in which its action counted.")
    fallbacks: int = Field(description="Slots in which the fallback was used.")
    last_cause: str = Field(description="Why it last fell back, or empty.")


class HomesStatus(Message):
    """All homes now, and their totals since the start of the run."""

    homes: tuple[AgentId, ...]
    agents: tuple[AgentId, ...] = Field(description="The agent that commands each home.")
    capacity_kwh: Column
    pv_rated_kw: Column
    soc: Column
    battery_kw: Column
    injection_kw: Column
    pv_kw: Column
    load_kw: Column
    bill: Column = Field(description="Since the start of the run [$].")
    baseline_bill: Column = Field(description="The same without demand response [$].")


class Totals(Message):
    """The market's sums since the start of the run, and what they would be without demand response."""

    slots: int
    profit: float
    baseline_profit: float
    bills: float
    baseline_bills: float
    reserve_kwh: float = Field(description="Energy from all facilities but the first [kWh].")
    baseline_reserve_kwh: float
    curtailed_kwh: float
    unserved_kwh: float


class Histogram(Message):
    """How often something took how long, since the clock was started."""

    bounds_ms: tuple[float, ...] = Field(description="Upper bounds of all classes but the last, which has none [ms].")
    counts: tuple[int, ...] = Field(description="Number in each class.")
    sum_ms: float = Field(description="All together [ms].")


class Latency(Message):
    """Time from publishing an observation to the last awaited answer, over recent slots [ms]."""

    price_p50_ms: float
    price_p99_ms: float
    battery_p50_ms: float
    battery_p99_ms: float
    commit_p50_ms: float
    commit_p99_ms: float
    price: Histogram
    battery: Histogram
    commit: Histogram


class Status(Message):
    """The clock's answer to every control request."""

    run: RunName
    scenario: str
    seed: int
    state: Literal["waiting", "running", "paused", "ended"]
    speed: Speed
    day: int = Field(description="Day of the next slot to be settled.")
    slot: int = Field(description="Next slot to be settled.")
    slots_per_day: int
    dt_h: float
    days: int | None = Field(description="Length of the run, or null without end.")
    slots_per_s: float
    last: SettledSlot | None = Field(description="The last settled slot.")
    totals: Totals
    refused: dict[str, int] = Field(description="Refused messages by cause.")
    journal_waits: int = Field(description="How often a slot had to wait for the journal since the clock was started.")
    journal_wait_s: float = Field(description="How long the market has been waiting for its journal [s]; 0: it is not.")
    latency: Latency
    agents: tuple[AgentStatus, ...]
    homes: HomesStatus | None


class HistoryRequest(Message):
    """Settled slots from a journal position on."""

    since: int = Field(default=0, ge=0)
    limit: int = Field(default=100, ge=1, le=2000)
    homes: bool = Field(default=False, description="Whether each slot lists its homes.")


class HistoryReply(Message):
    """Settled slots in order; ask again from `next` for more."""

    run: RunName
    next: int
    slots: tuple[SettledSlot, ...]


class ScenarioRequest(Message):
    """Asks for the scenario that the market plays."""


class ScenarioReply(Message):
    """The complete scenario, as a file would hold it."""

    run: RunName
    yaml: str


class PolicyRequest(Message):
    """Asks an agent what it would do. Give either raw observation vectors or named quantities through the gateway."""

    observations: tuple[Annotated[tuple[float, ...], Field(fail_fast=True)], ...] = Field(
        fail_fast=True, min_length=1, max_length=10_000, description="Rows in the order of the policy's features."
    )
    home: AgentId | None = Field(default=None, description="Which of its homes; null: the first.")


class PolicyReply(Message):
    """What the agent would do, row by row."""

    agent: AgentId
    policy: str
    version: str
    features: tuple[str, ...]
    levels: tuple[float, ...] = Field(description="Actions the Q-values stand for; empty where the policy has none.")
    actions: tuple[float, ...]
    q_values: tuple[tuple[float, ...], ...] | None
