"""The optimality gap of trained prosumers with hindsight, and against what an agent can know.

    python benchmarks/foresight.py
    zengrid train paper --seeds 5 --preset thorough --out runs/thorough
    python benchmarks/foresight.py runs/thorough

Claim: docs/measurements/learning-attempts.md ("Foresight").
Takes a minute for each pair of policies; needs no more than
policies for the scenario ``paper``, by default those that come with zengrid.

A best response knows the whole day; an agent sees its state of charge, PV, consumption and the price of the slot, and
the time. Between them is the *informed response*, the best policy of that kind that dynamic programming finds over the
same states of charge. It estimates later costs by regression on what is seen now, over thousands of training days
played under the same policies (least squares Monte Carlo: Longstaff, Schwartz, 2001, doi:10.1093/rfs/14.1.113), and is
then played on held-out days. What the best response gains beyond it is foresight.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kit.script import parse_options, script_parser, write_results
from zengrid.core.bounds import MOST_STATES
from zengrid.core.home_physics import battery_step, meter
from zengrid.core.lattice import Lattice
from zengrid.core.levels import level_commands
from zengrid.env.facts import market_facts
from zengrid.learn.evaluation import Evaluator, Played
from zengrid.policy.network import GridNetwork, ProsumerNetwork
from zengrid.policy.trained import FOLDER as SHIPPED
from zengrid.scenario import Days, Scenario, load

Floats = NDArray[np.float64]

RIDGE = 1e-3
"""Keeps the regression stable where a price never came up."""


def main() -> None:
    """Evaluate each pair of policies in a folder."""
    parser = script_parser(__doc__, __file__)
    parser.add_argument("folder", type=Path, nargs="?", default=SHIPPED, help="of zengrid train, in the scenario paper")
    parser.add_argument("--train-days", type=int, default=4096, help="to estimate from (default: %(default)s)")
    parser.add_argument("--days", type=int, default=256, help="held-out days (default: %(default)s)")
    options = parse_options(parser, {"train_days": 256, "days": 16})
    grids = sorted(options.folder.glob("best-*-grid.safetensors")) or sorted(options.folder.glob("*-grid.safetensors"))
    if not grids:
        raise SystemExit(f"{options.folder}: holds no file *-grid.safetensors; give a folder of zengrid train")
    paper = load("paper")
    known, held = Evaluator(paper, Days(paper).training(options.train_days)), Evaluator.held_out(paper, options.days)
    results = {}
    print(f"{'':14}{'gap with hindsight [%]':>26}{'gap as informed [%]':>26}{'foresight [%]':>26}")
    for grid in grids:
        name = grid.name.removeprefix("best-").removesuffix("-grid.safetensors")
        results[name] = measure(paper, known, held, grid)
        columns = "".join(f"{' '.join(f'{value:7.1f}' for value in row):>26}" for row in results[name].values())
        print(f"{name:14}{columns}")
    write_results(options.out, percent_of_saving=results)


def measure(paper: Scenario, known: Evaluator, held: Evaluator, grid: Path) -> dict[str, list[float]]:
    """Gaps of one market's prosumers, in percent of what they save."""
    prosumers = ProsumerNetwork.load(
        grid.with_name(grid.name.replace("-grid.", "-prosumers.")), market_facts(paper, paper.home_ids)
    )
    leader = GridNetwork.load(grid, market_facts(paper))
    seen, played = known.play(leader, prosumers), held.play(leader, prosumers)
    agents = held.outcome(played.settled)
    saving = held.conventional.bill - agents.bill
    commands_kw = level_commands(paper.battery_levels, held.market.homes)
    hindsight = held.gap(played, agents, commands_kw).dollars
    informed = agents.bill - Informed(known, seen, commands_kw).play(held, played)
    return {
        "hindsight": (100.0 * hindsight / saving).tolist(),
        "informed": (100.0 * informed / saving).tolist(),
        "foresight": (100.0 * (hindsight - informed) / saving).tolist(),
    }


class Informed:
    """A policy of every home that estimates the rest of the day from what it sees.

    Parameters
    ----------
    known:
        Days to estimate from, ``(slot, day, ...)``.
    played:
        What happened on them; its prices are taken as given.
    commands_kw:
        ``(level, home)``. [kW]
    """

    def __init__(self, known: Evaluator, played: Played, commands_kw: Floats) -> None:
        self.market, self.levels = known.market, np.array(known.scenario.buy_prices)
        homes = self.market.homes
        lattice = Lattice.closed(self.market, commands_kw, homes.soc_initial, MOST_STATES)
        assert lattice is not None  # lossless batteries
        self.lattice, self.homes = lattice, np.arange(homes.count)
        # (state, level, home): what each command does, and to which state it leads.
        self.battery_kw, after = battery_step(lattice.soc[:, None, :], commands_kw[None], self.market)
        self.leads_to = lattice.locate(after)[0] // homes.count
        day, slots = known.profile, len(played.buy_price)
        self.fits: list[Any] = [None] * slots
        """of each slot but the last: mean and deviation of the features, and coefficients (home, feature, state)"""
        for slot in range(slots - 2, -1, -1):
            cost = self.cost(slot + 1, day.pv_kw[slot + 1], day.load_kw[slot + 1], played.buy_price[slot + 1],
                             day.sell_price[slot + 1]).min(axis=2)  # fmt: skip
            features = self.features(day.pv_kw[slot], day.load_kw[slot], played.buy_price[slot])
            mean, deviation = features.mean(axis=0), features.std(axis=0) + 1e-9
            mean[:, 0], deviation[:, 0] = 0.0, 1.0
            x = np.moveaxis((features - mean) / deviation, 1, 0)  # (home, day, feature)
            square = np.swapaxes(x, 1, 2) @ x + RIDGE * len(cost) * np.eye(x.shape[-1])
            self.fits[slot] = mean, deviation, np.linalg.solve(square, np.swapaxes(x, 1, 2) @ np.moveaxis(cost, 2, 0))

    def features(self, pv_kw: Floats, load_kw: Floats, buy_price: Floats) -> Floats:
        """Features of what a home sees in a slot, for a linear regression, ``(day, home, feature)``."""
        price = np.broadcast_to(buy_price[:, None], pv_kw.shape)
        above = (price - self.levels[0]) * 100.0
        plain = [np.ones_like(pv_kw), pv_kw, load_kw, pv_kw**2, load_kw**2, pv_kw * load_kw, above * pv_kw]
        levels = [(np.abs(price - level) < 1e-9) * 1.0 for level in self.levels[1:]]
        return np.stack([*plain, above * load_kw, *levels], axis=-1)

    def cost(self, slot: int, pv_kw: Floats, load_kw: Floats, buy_price: Floats, sell_price: Floats) -> Floats:
        """Cost of each command from each state, expected later costs included, ``(day, state, level, home)``. [$]"""
        net_kw = (pv_kw - load_kw)[:, None, None, :]
        _, export_kw, import_kw, _, _ = meter(net_kw - self.battery_kw, self.market)
        buy, sell = buy_price[:, None, None, None], sell_price[:, None, None, None]
        cost: Floats = (import_kw * sell - export_kw * buy) * self.market.dt_h
        if self.fits[slot] is not None:
            mean, deviation, coefficients = self.fits[slot]
            features = (self.features(pv_kw, load_kw, buy_price) - mean) / deviation
            later = np.einsum("dhf,hfs->dsh", features, coefficients)
            cost += later[:, self.leads_to, self.homes]
        return cost

    def play(self, held: Evaluator, played: Played) -> Floats:
        """Mean bill of each home on other days, under the prices played there, ``(home,)``. [$/day]"""
        day, days = held.profile, np.arange(held.chains)[:, None]
        state = np.broadcast_to(
            self.lattice.locate(self.market.homes.soc_initial[None])[0] // self.homes.size,
            (held.chains, self.homes.size),
        )
        bill = np.zeros(state.shape)
        for slot in range(len(played.buy_price)):
            now = day.pv_kw[slot], day.load_kw[slot], played.buy_price[slot], day.sell_price[slot]
            level = self.cost(slot, *now)[days, state, :, self.homes].argmin(axis=-1)
            _, export_kw, import_kw, _, _ = meter(
                now[0] - now[1] - self.battery_kw[state, level, self.homes], self.market
            )
            bill += (import_kw * now[3][:, None] - export_kw * now[2][:, None]) * self.market.dt_h
            state = self.leads_to[state, level, self.homes]
        return np.asarray(bill.mean(axis=0))


if __name__ == "__main__":
    main()
