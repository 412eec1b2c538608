"""The market that every peer plays: homes and days of the scenario ``paper``, settled by zengrid's core.

A slot is two exchanges: the environment sends the grid agent an observation and gets the buy price; it sends every home
that price and an observation and gets a battery command. Then it settles. ``reference`` plays the same slots in a plain
loop with zengrid's own policies; a peer's settlement has to equal it to the last bit.
"""

from __future__ import annotations

import argparse
import json
import socket
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from agent_rules import GRID_POLICY, PROSUMER_POLICY
from zengrid.core.settle import settle
from zengrid.core.state import Action
from zengrid.scenario import Days, Scenario, load


class Environment:
    """The state of the market between two slots.

    Parameters
    ----------
    homes:
        How many; the three of ``paper`` in turn.
    """

    def __init__(self, homes: int) -> None:
        self.scenario = scenario = paper(homes)
        self.market, self.days = scenario.market(), Days(scenario)
        self.limits_kw = list(
            zip(self.market.homes.charge_max_kw.tolist(), self.market.homes.discharge_max_kw.tolist(), strict=True)
        )
        self.slots = 0
        """settled so far"""
        self.profits: list[float] = []
        """profit of the grid, slot by slot [$]"""
        self.bills: list[list[float]] = []
        """bill of each home, slot by slot [$]"""
        self._soc = self.market.homes.soc_initial
        self._demand_kw = self._payments = 0.0
        self._begin()

    def _begin(self) -> None:
        """Look up what the coming slot brings; stored energy carries over from day to day, as in a live market."""
        day, slot = divmod(self.slots, self.scenario.slots_per_day)
        if slot == 0:
            self._profile = self.days.day(day)
        self._slot, self._now = slot, self._profile.slot(slot)

    def observe(self) -> tuple[list[float], list[list[float]]]:
        """Observations of the grid agent and of each home, as ``agent_rules`` describes them."""
        now = self._now
        grid = [float(self._slot), self._demand_kw, self._payments, float(now.sell_price)]
        columns = zip(self._soc.tolist(), now.pv_kw.tolist(), now.load_kw.tolist(), self.limits_kw, strict=True)
        return grid, [[soc, pv_kw, load_kw, *limits_kw] for soc, pv_kw, load_kw, limits_kw in columns]

    def settle(self, buy_price: float, battery_kw: Sequence[float]) -> None:
        """Settle the slot under a price [$/kWh] and a command for each home [kW]."""
        settled = settle(self._soc, Action(np.asarray(buy_price), np.asarray(battery_kw)), self._now, self.market)
        self._soc = settled.soc
        self._demand_kw, self._payments = float(settled.demand_kw), float(settled.payments)
        self.profits.append(float(settled.profit))
        self.bills.append(settled.bill.tolist())
        self.slots += 1
        self._begin()


def paper(homes: int) -> Scenario:
    """The scenario ``paper`` with its three homes in turn, ``p1``, ``p2`` and so on."""
    scenario = load("paper")
    three = scenario.homes
    copies = [three[i % 3].model_copy(update={"id": f"p{i + 1}"}) for i in range(homes)]
    return scenario.model_copy(update={"homes": copies})


def reference(homes: int, slots: int) -> tuple[list[float], list[list[float]]]:
    """Play the slots in a plain loop with zengrid's own policies.

    Returns
    -------
    profits, bills:
        Profit of the grid ``(slot,)`` and bill of each home ``(slot, home)``. [$]
    """
    # Only the process that checks needs these.
    from zengrid.env.facts import market_facts
    from zengrid.env.vector import VectorMarket
    from zengrid.policy.registry import make_grid_policy, make_prosumer_policy

    scenario = paper(homes)
    market, days = VectorMarket(scenario.market(), (), scenario.buy_prices), Days(scenario)
    prosumers = make_prosumer_policy(PROSUMER_POLICY, market_facts(scenario, scenario.home_ids))
    grid = make_grid_policy(GRID_POLICY, market_facts(scenario))
    profits, bills = [], []
    for position in range(slots):
        day, slot = divmod(position, scenario.slots_per_day)
        if slot == 0:
            market.begin(days.day(day), day=day)
        price = grid.act(market.grid_view())
        settled = market.step(price, prosumers.act(market.prosumer_view(price)))
        profits.append(float(settled.profit))
        bills.append(settled.bill.tolist())
    return profits, bills


def check_settlement(homes: int, profits: Sequence[float], bills: Sequence[Sequence[float]]) -> str:
    """Compare a peer's settlement with the reference; exits where any bit differs.

    Returns
    -------
    A sentence to print.
    """
    true_profits, true_bills = reference(homes, len(profits))
    for slot, (profit, bill) in enumerate(zip(profits, bills, strict=True)):
        if profit != true_profits[slot] or list(bill) != true_bills[slot]:
            raise SystemExit(
                f"slot {slot}: the peer settled a profit of {profit!r} $ and bills of {list(bill)!r} $; "
                f"zengrid's core settles {true_profits[slot]!r} and {true_bills[slot]!r}"
            )
    return f"{len(profits)} slots settled, equal to zengrid's core to the last bit"


def peer_parser(doc: str | None, script: str) -> argparse.ArgumentParser:
    """Options of every peer that plays the market."""
    parser = argparse.ArgumentParser(
        prog=f"python benchmarks/peers/{script}", description=doc, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--homes", type=int, default=3)
    parser.add_argument("--slots", type=int, default=600, help="that count (default: %(default)s)")
    parser.add_argument("--warm-up", type=int, default=60, help="slots before them (default: %(default)s)")
    parser.add_argument("--timeout", type=float, default=60.0, help="of the whole run [s] (default: %(default)g)")
    return parser


Exchange = Callable[[list[float], list[list[float]]], tuple[float, list[float]]]
"""Observations of the grid and of each home -> buy price [$/kWh] and the command of each home [kW]."""


def play_in_lockstep(homes: int, warm_up: int, slots: int, exchange: Exchange) -> dict[str, Any]:
    """The environment's part in a peer that returns the decisions of a slot for its observations.

    Parameters
    ----------
    homes, warm_up, slots:
        Homes, slots before those that count, and slots that count.
    exchange:
        Sends the observations of a slot to the agents and returns their decisions.

    Returns
    -------
    Figures, profits and bills, ready for JSON.
    """
    environment = Environment(homes)
    first = begin = 0.0
    for slot in range(warm_up + slots):
        if slot == warm_up:
            begin = time.monotonic()
        environment.settle(*exchange(*environment.observe()))
        if slot == 0:
            first = time.monotonic()
    return result(environment, first, slots / (time.monotonic() - begin))


def result(environment: Environment, first: float, slots_s: float) -> dict[str, Any]:
    """What a run hands to ``report``: ``first`` is the monotonic time at which the first slot was settled. [s]"""
    return {"first": first, "slots_s": slots_s, "profits": environment.profits, "bills": environment.bills}


def report(system: str, homes: int, began: float, run: dict[str, Any], **figures: float) -> None:
    """Check the settlement of a run, and print its figures as one line of JSON."""
    checked = check_settlement(homes, run["profits"], run["bills"])
    row = {"system": system, "homes": homes, "slots_s": run["slots_s"], "first_slot_s": run["first"] - began}
    print(json.dumps({**row, **figures, "settlement": checked}))


def free_port() -> int:
    """A TCP port on loopback that nobody uses at the moment."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
