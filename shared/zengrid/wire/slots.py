"""The messages of every slot: observations, actions, and the public state of the market."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from zengrid.wire.base import AgentId, Column, Instance, Message, Price, SlotColumn, SlotMessage

PHASE_PRICE: Literal["price"] = "price"
PHASE_BATTERY: Literal["battery"] = "battery"


class GridSettled(Message):
    """What came of the grid agent's previous slot."""

    day: int
    slot: int
    buy_price: Price
    reward: float = Field(description="Profit of the slot [$], paper eq. 16.")
    fallback: bool = Field(description="The agent did not answer: its last price was kept.")


class GridObservation(SlotMessage):
    """What the grid agent may see (paper eq. 14): the outcome of the last settled slot, and what is public."""

    phase: Literal["price", "end"] = Field(
        default=PHASE_PRICE,
        description="`end`: the market is over, `settled` is the last reward, no answer is expected.",
    )
    hour: float = Field(ge=0, lt=24, description="Local time at the start of the slot [h].")
    deadline_s: float = Field(gt=0, description="Time to answer [s].")
    sell_price: Price
    homes: int = Field(ge=0, description="Number of prosumer homes in the market.")
    facility_cost: SlotColumn = Field(description="F: cost of each facility in the last slot [$]; zeros at first.")
    payment: SlotColumn | None = Field(
        description="Omega: paid to each home in the last slot [$]; only where it joined with observation `paper`."
    )
    payments: float = Field(description="Sum of Omega [$].")
    demand_kw: float = Field(ge=0, description="P_dm of the last slot [kW].")
    settled: GridSettled | None = Field(description="Reward of the previous slot; null before the first.")


class GridAction(SlotMessage):
    """The grid agent's answer: the price at which the grid buys."""

    phase: Literal["price"] = PHASE_PRICE
    instance: Instance
    buy_price: Price = Field(description="One of the levels of the join reply [$/kWh].")


class FleetSettled(Message):
    """What came of the previous slot of an agent's homes."""

    day: int
    slot: int
    buy_price: Price
    reward: SlotColumn = Field(description="-bill of each home [$], paper eq. 17 with its sign mended.")
    battery_kw: SlotColumn = Field(description="What each battery really did, > 0 charged [kW].")
    injection_kw: SlotColumn = Field(description="At each meter, > 0 exported [kW].")
    fallback: bool = Field(description="The agent did not answer: the conventional rule was used.")


class FleetObservation(SlotMessage):
    """What a prosumer agent may see (paper eq. 15), one entry per home. A single home is a fleet of one."""

    phase: Literal["battery", "end"] = Field(
        default=PHASE_BATTERY,
        description="`end`: the market is over, `settled` is the last reward, no answer is expected.",
    )
    hour: float = Field(ge=0, lt=24, description="Local time at the start of the slot [h].")
    deadline_s: float = Field(gt=0, description="Time to answer [s].")
    buy_price: Price
    sell_price: Price
    soc: SlotColumn = Field(description="State of charge [-].")
    pv_kw: SlotColumn = Field(description="PV generation in this slot [kW].")
    load_kw: SlotColumn = Field(description="Consumption in this slot [kW].")
    settled: FleetSettled | None = Field(description="Reward of the previous slot; null before the first.")


class FleetAction(SlotMessage):
    """A prosumer agent's answer: one command per home."""

    phase: Literal["battery"] = PHASE_BATTERY
    instance: Instance
    battery_kw: SlotColumn = Field(description="Command to each battery, > 0 charges, within its power limits [kW].")


class PublicSlot(SlotMessage):
    """The public state of a settled slot, published on `clock/slot`."""

    position: int = Field(ge=0, description="Position in the journal: 0, 1, 2, ...")
    hour: float = Field(ge=0, lt=24, description="Local time at the start of the slot [h].")
    dt_h: float = Field(gt=0, description="Length of the slot [h].")
    state: Literal["running", "paused", "ended"] = Field(description="State of the market when this was published.")
    buy_price: Price
    sell_price: Price
    demand_kw: float = Field(description="All that the grid sells [kW].")
    export_kw: float = Field(description="All that the homes export [kW].")
    facility_kw: Column = Field(description="Output of each facility, base first [kW].")
    facility_cost: Column = Field(description="Cost of each facility [$].")
    curtailed_kwh: float = Field(description="Energy nobody could take [kWh].")
    unserved_kwh: float = Field(description="Demand nobody could meet [kWh].")
    homes: int = Field(ge=0, description="Homes in the market.")
    acted: tuple[AgentId, ...] = Field(description="Agents whose action counted.")
    fallback: tuple[AgentId, ...] = Field(description="Agents for which the fallback was used.")


class HomeColumns(Message):
    """One slot of every home, for operators: not public."""

    homes: tuple[AgentId, ...]
    soc: Column = Field(description="At the end of the slot [-].")
    battery_kw: Column
    injection_kw: Column
    pv_kw: Column
    load_kw: Column
    bill: Column = Field(description="[$]")
    baseline_soc: Column
    baseline_bill: Column = Field(description="What the slot would have cost without demand response [$].")
    fallback: tuple[AgentId, ...] = Field(description="Homes served by the fallback.")


class SettledSlot(PublicSlot):
    """A settled slot as the journal holds it, answered on `clock/history`."""

    profit: float = Field(description="Profit of the grid [$].")
    baseline_profit: float = Field(description="Profit without demand response [$].")
    baseline_facility_kw: Column
    detail: HomeColumns | None = Field(description="Per home, where asked for.")
