"""The adapters pass the conformance tests of the projects they adapt to, and settle what the core settles."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("pettingzoo", reason="extra env is not installed")
pytest.importorskip("gymnasium", reason="extra env is not installed")

from gymnasium.utils.env_checker import check_env
from pettingzoo.test import api_test, parallel_api_test, parallel_seed_test, seed_test

from zengrid.core.levels import level_commands
from zengrid.core.settle import settle
from zengrid.core.state import Action
from zengrid.env.aec import MarketAEC
from zengrid.env.parallel import MarketParallel
from zengrid.env.single import MarketEnv
from zengrid.errors import ScenarioError
from zengrid.scenario import Days, load

OPTIONS: list[dict[str, Any]] = [
    {},
    {"observation": "paper", "part": "evaluation"},
    {"scenario": load("paper").with_(soc_reset="never", slot_minutes=240, tariff=[{"from": "00:00", "price": 0.08}])},
    {"scenario": load("paper").with_(slot_minutes=60), "days": 2},
]
IDS = ["public", "paper", "never, long slots", "two days"]


# Advice that this market cannot take: agents are called as in the scenario, leader and followers see and do different
# things, and the grid sees zeros before the first slot was settled.
@pytest.mark.filterwarnings("ignore:We recommend agents to be named")
@pytest.mark.filterwarnings("ignore:Agents have different")
@pytest.mark.filterwarnings("ignore:Observations are different shapes")
@pytest.mark.filterwarnings("ignore:Observation numpy array is all zeros")
@pytest.mark.parametrize("options", OPTIONS, ids=IDS)
def test_pettingzoo_accepts_the_aec_form(options: dict[str, Any], capsys: pytest.CaptureFixture[str]) -> None:
    api_test(MarketAEC(**options), num_cycles=200, verbose_progress=False)
    seed_test(lambda: MarketAEC(**options), num_cycles=60)


@pytest.mark.parametrize("options", OPTIONS, ids=IDS)
def test_pettingzoo_accepts_the_parallel_form(options: dict[str, Any], capsys: pytest.CaptureFixture[str]) -> None:
    parallel_api_test(MarketParallel(**options), num_cycles=60)
    parallel_seed_test(lambda: MarketParallel(**options), num_cycles=60)


@pytest.mark.parametrize("options", OPTIONS, ids=IDS)
@pytest.mark.parametrize("agent", ["grid", "p2"])
def test_gymnasium_accepts_one_agent_among_policies(agent: str, options: dict[str, Any]) -> None:
    check_env(MarketEnv(agent, {"p1": "random:3", "grid": "tou:0.05,20:00=0.09"}, **options), skip_render_check=True)


def test_the_aec_form_settles_what_the_core_settles() -> None:
    scenario = load("paper")
    market, day = scenario.market(), Days(scenario).day(5)
    commands = level_commands(scenario.battery_levels, market.homes)
    env, rng = MarketAEC(scenario=scenario, part="evaluation"), np.random.default_rng(1)
    env.reset(options={"day": 5})
    soc = market.homes.soc_initial
    for slot in range(scenario.slots_per_day):
        price, levels = int(rng.integers(6)), rng.integers(5, size=3)
        for action in (price, *levels):
            env.step(int(action))
        action = Action(np.asarray(scenario.buy_prices[price]), commands[levels, np.arange(3)])
        settled = settle(soc, action, day.slot(slot), market)
        assert env.rewards == {"grid": settled.profit, **dict(zip(("p1", "p2", "p3"), -settled.bill, strict=True))}
        soc = settled.soc
    assert all(env.terminations.values())
    assert not any(env.truncations.values())


def test_homes_see_the_price_of_their_slot() -> None:
    env = MarketAEC()
    env.reset(seed=1)
    for price in (5, 0, 3):
        env.step(price)
        for _ in range(3):
            seen = env.last()[0]
            assert seen is not None
            assert seen[3] == env.episode.buy_prices[price]
            env.step(2)
    parallel = MarketParallel()
    seen, _ = parallel.reset(seed=1)
    assert seen["p1"][3] == 0.05
    seen, *_ = parallel.step({"grid": 4, "p1": 2, "p2": 2, "p3": 2})
    assert seen["p1"][3] == 0.09


def test_all_forms_of_the_market_pay_the_same() -> None:
    """One home at random among conventional ones, at a fixed price: alone in Gymnasium, and among all in PettingZoo."""
    rng = np.random.default_rng(3)
    single, many = MarketEnv("p2"), MarketAEC()
    single.reset(options={"day": 10_001})
    many.reset(options={"day": 10_001})
    for _ in range(24):
        level = int(rng.integers(5))
        others = single.episode.vector.prosumer_view(0.05)
        reward = single.step(level)[1]
        commands = np.array([0.0, many.episode.command("p2", level), 0.0])
        for place in (0, 2):
            commands[place] = single._others[place].act(others._replace(**_one(others, place)))[0]
        many.episode.buy_price = 0.05
        assert many.episode.rewards(many.episode.step(commands))["p2"] == reward


def _one(view: Any, place: int) -> dict[str, Any]:
    part = slice(place, place + 1)
    homes = view.homes.take([place])
    return {"soc": view.soc[part], "pv_kw": view.pv_kw[part], "load_kw": view.load_kw[part], "homes": homes}


def test_an_unknown_agent_is_refused() -> None:
    with pytest.raises(ScenarioError, match="agent = p9: permitted: grid, p1, p2, p3"):
        MarketEnv("p9")
