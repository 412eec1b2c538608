"""The policies that come with zengrid: read from the package, fitting where they should, better than the rule."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from support.policy_days import PAPER
from zengrid.core.params import HOME_FIELDS, Homes
from zengrid.core.settle import total
from zengrid.env.facts import market_facts
from zengrid.env.vector import VectorMarket, slots_first
from zengrid.errors import PolicyError
from zengrid.policy import trained
from zengrid.policy.network import GridNetwork, Network, ProsumerNetwork
from zengrid.policy.registry import make_grid_policy, make_prosumer_policy
from zengrid.policy.relative import SIZES
from zengrid.policy.rules import Conventional, FixedPrice
from zengrid.scenario import Days, load


@pytest.mark.parametrize("name", [trained.GRID, trained.PROSUMERS, trained.GENERIC])
def test_files_of_the_package_tell_how_they_were_made(name: str) -> None:
    notes = trained.load(name).training
    assert notes["command"] == "make policies"
    assert {"scenario", "seed", "steps", "version"} <= set(notes)


def test_trained_is_the_case_studys_own_in_its_market() -> None:
    assert make_grid_policy("trained", market_facts(PAPER)).name == trained.GRID
    assert make_prosumer_policy("trained", market_facts(PAPER, ("p3", "p1"))).name == trained.PROSUMERS


def test_newcomers_get_the_generic_one_and_other_markets_the_rules() -> None:
    larger = PAPER.with_(**{"homes.*.battery.capacity_kwh": 15})
    newcomer = replace(market_facts(PAPER, ("p1",)), home_ids=("p4",))
    for facts in (market_facts(larger, larger.home_ids), newcomer):
        assert make_prosumer_policy("trained", facts).name == trained.GENERIC
    village = load("village")
    facts = market_facts(village, village.home_ids[:2])
    assert isinstance(make_prosumer_policy("trained", facts), Conventional)
    assert trained.for_prosumer(facts).why.endswith("scenario = village: it was trained in paper")
    assert make_prosumer_policy("generic", facts).name == trained.GENERIC
    assert isinstance(make_grid_policy("trained", market_facts(village)), FixedPrice)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"dt_h": 0.25, "slots_per_day": 96}, "dt_h = 0.25: it was trained on slots of 1 h"),
        ({"buy_prices": (0.05, 0.2)}, "buy_price = 0.05 to 0.2: it was trained on 0.05 to 0.1"),
        ({"sell_prices": (0.3,) * 24}, "sell_price = 0.3 to 0.3"),
    ],
)
def test_where_none_fits_the_rule_plays_and_says_why(changes: dict[str, object], says: str) -> None:
    facts = replace(market_facts(PAPER, ("p1",)), **changes)  # type: ignore[arg-type]
    choice = trained.for_prosumer(facts)
    assert choice.file is None
    assert says in choice.why
    assert isinstance(make_prosumer_policy("trained", facts), Conventional)
    facts = replace(market_facts(PAPER), **changes)  # type: ignore[arg-type]
    assert trained.for_grid(facts).file is None


def test_everybody_is_better_off_than_without_demand_response() -> None:
    scenario = PAPER.with_(soc_reset="never")
    days = Days(scenario)
    profile = days.days(days.evaluation(14))
    figures = []
    for grid, homes in (("trained", "trained"), ("fixed", "conventional")):
        price = make_grid_policy(grid, market_facts(scenario))
        policy = make_prosumer_policy(homes, market_facts(scenario, scenario.home_ids))
        market = VectorMarket(scenario.market(), (1,), scenario.buy_prices)
        sums = np.zeros(5)
        for day in range(14):
            one = slots_first(type(profile)(*(column[day : day + 1] for column in profile)))
            market.begin(one, scenario.market().homes.soc_initial if day == 0 else None, day)
            while not market.over:
                bought = np.asarray(price.act(market.grid_view()))
                settled = market.step(bought, policy.act(market.prosumer_view(bought)))
                reserve_kw = total(settled.facility_kw[..., 1:])
                sums += [*settled.bill[0], -float(settled.profit[0]), float(reserve_kw[0])]
        figures.append(sums)
    assert (figures[0] < figures[1]).all()


def test_one_network_for_all_homes_sees_them_by_their_own_size() -> None:
    generic = trained.load(trained.GENERIC)
    facts = market_facts(PAPER, PAPER.home_ids)
    twice = Homes(**{
        name: getattr(facts.homes, name) * (2.0 if name.endswith(("_kw", "_kwh")) else 1.0) for name in HOME_FIELDS
    })  # fmt: skip
    view = VectorMarket(PAPER.market(), (), PAPER.buy_prices)
    view.begin(Days(PAPER).day(0), facts.homes.soc_initial)
    view.slot = 12
    small = view.prosumer_view(0.05)
    large = small._replace(pv_kw=small.pv_kw * 2.0, load_kw=small.load_kw * 2.0, homes=twice)
    doubled = replace(facts, homes=twice, pv_kw=tuple(2.0 * kw for kw in facts.pv_kw))
    np.testing.assert_allclose(
        ProsumerNetwork(generic, doubled).act(large), 2.0 * ProsumerNetwork(generic, facts).act(small), rtol=1e-9
    )


def test_a_network_for_each_home_made_of_it_is_worth_the_same() -> None:
    generic = trained.load(trained.GENERIC)
    facts = market_facts(PAPER, PAPER.home_ids)
    own = generic.for_homes(facts.home_ids, facts.homes, np.array(facts.pv_kw))
    rows = np.random.default_rng(3).uniform(0.0, 1.0, (20, 3, len(own.features)))
    relative = ProsumerNetwork(generic, facts)
    assert relative._relative is not None
    wanted = Network(generic).q_values(relative._relative(rows))
    np.testing.assert_allclose(Network(own, facts.home_ids).q_values(rows), wanted, rtol=1e-5, atol=1e-4)


def test_files_for_homes_of_any_size_are_checked() -> None:
    generic = trained.load(trained.GENERIC)
    assert generic.features[-len(SIZES) :] == SIZES
    with pytest.raises(PolicyError, match="relative = true: permitted for a prosumer's network that serves all homes"):
        replace(generic, homes=("p1",))
    with pytest.raises(PolicyError, match="pv_kw: this policy needs the rated PV power"):
        ProsumerNetwork(generic, replace(market_facts(PAPER, ("p1",)), pv_kw=()))
    with pytest.raises(PolicyError, match="role = prosumer: a grid is wanted"):
        GridNetwork(generic, market_facts(PAPER))
