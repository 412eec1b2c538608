"""The conventional rule, and the case study's figures under it."""

from __future__ import annotations

import csv
from importlib.resources import files

import numpy as np
import pytest
from hypothesis import given

from support.random_slots import Slot, slots
from zengrid.core.baselines import BASELINE_BUY_PRICE, conventional
from zengrid.core.params import Facilities, Homes, MarketParams
from zengrid.core.settle import settle
from zengrid.core.state import Action, Exogenous, Settlement


def test_surplus_is_stored_and_a_deficit_served() -> None:
    homes = Homes.of([6.0] * 4, charge_max_kw=2.0, discharge_max_kw=1.0)
    pv_kw, load_kw = np.array([3.0, 9.0, 0.0, 0.0]), np.array([2.0, 1.0, 0.5, 4.0])
    assert conventional(pv_kw, load_kw, homes).tolist() == [1.0, 2.0, -0.5, -1.0]


@given(slots())
def test_it_neither_buys_to_store_nor_sells_what_it_stored(slot: Slot) -> None:
    soc, action, exogenous, market = slot
    rule = conventional(exogenous.pv_kw, exogenous.load_kw, market.homes)
    settled = settle(soc, Action(action.buy_price, rule), exogenous, market)
    assert np.all((settled.battery_kw <= 0.0) | (settled.home_import_kw == 0.0))
    assert np.all((settled.battery_kw >= 0.0) | (settled.home_export_kw <= 1e-12))
    full = (settled.soc >= market.homes.soc_max - 1e-12) | (settled.battery_kw >= market.homes.charge_max_kw - 1e-12)
    assert np.all((settled.home_export_kw <= 1e-12) | full | (market.homes.capacity_kwh == 0.0))


def case_study(minutes: int) -> tuple[Exogenous, MarketParams]:
    """The day and the market of the scenario `paper`."""
    with (files("zengrid.scenario") / "data" / f"paper_{minutes}min.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    column = {name: np.array([float(row[name]) for row in rows]) for name in rows[0] if name != "time"}
    day = Exogenous(
        pv_kw=np.stack([column["pv_kw"]] * 3, axis=-1),
        load_kw=np.stack([column[f"prosumer{j}_load_kw"] for j in (1, 2, 3)], axis=-1),
        consumer_kw=column["consumer_load_kw"][:, None],
        sell_price=np.where(np.arange(len(rows)) * minutes < 11 * 60, 0.05, 0.095),
    )
    homes = Homes.of([6.0, 12.0, 8.0], soc_initial=np.array([3.0, 4.0, 3.5]) / [6.0, 12.0, 8.0])
    plant = Facilities.of(p_max_kw=[20.0, 50.0], cost_b=[0.03, 0.33], cost_a=[0.0, 0.012], p_min_kw=[5.0, 0.0])
    return day, MarketParams(homes, plant, dt_h=minutes / 60)


def conventional_day(minutes: int) -> tuple[list[Settlement], MarketParams]:
    day, market = case_study(minutes)
    soc, settled = market.homes.soc_initial, []
    for slot in range(len(day.sell_price)):
        now = day.slot(slot)
        rule = conventional(now.pv_kw, now.load_kw, market.homes)
        settled.append(settle(soc, Action(np.array(BASELINE_BUY_PRICE), rule), now, market))
        soc = settled[-1].soc
    return settled, market


# Hourly figures: an independent calculation that came with the profiles. Quarters of an hour differ a little, since
# surplus and deficit of one hour no longer cancel.
@pytest.mark.parametrize(
    ("minutes", "bills", "profit", "reserve_kwh"),
    [(60, [0.118, 0.330, 0.483], 10.21, 22.6), (15, [0.117, 0.330, 0.482], 9.99, 23.1)],
)
def test_the_case_study_under_the_conventional_rule(
    minutes: int, bills: list[float], profit: float, reserve_kwh: float
) -> None:
    day, market = conventional_day(minutes)
    assert sum(slot.bill for slot in day) == pytest.approx(bills, abs=0.0005)
    assert sum(slot.profit for slot in day) == pytest.approx(profit, abs=0.006)
    assert sum(slot.facility_kw[1] for slot in day) * market.dt_h == pytest.approx(reserve_kwh, abs=0.05)
