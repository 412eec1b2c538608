"""Recomputes energy and money of settled slots: what remains of each balance, which must be zero."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Columns = Mapping[str, NDArray[Any]]

TOLERANCE = 1e-9
"""Largest imbalance of a slot, in kWh or $; relative to the slot's total if that is more than 1. [-]"""


class Balance(NamedTuple):
    """One balance over some slots.

    residual: ``(slot,)`` left side less right side. [kWh] or [$]
    scale: ``(slot,)`` energy or money that the slot moves in all, at least 1. [kWh] or [$]
    """

    name: str
    residual: Floats
    scale: Floats

    @property
    def broken(self) -> NDArray[np.bool_]:
        """Slots in which the residual is more than rounding, or not a number, ``(slot,)``."""
        return ~(np.abs(self.residual) <= TOLERANCE * self.scale)


def balances(columns: Columns, dt_h: float) -> Iterator[Balance]:
    """Recompute energy at the meters and in the market, and money from energy and prices.

    Parameters
    ----------
    columns:
        Arrays by the names of ``Settlement`` and ``Exogenous``: ``(slot,)`` for the market, ``(slot, facility)`` and
        ``(slot, home)``. ``consumer_kw``, ``home_curtailed_kw`` and ``home_unserved_kw`` are sums, ``(slot,)``.
    dt_h:
        Length of a slot. [h]
    """
    yield from energy_balances(columns, dt_h)
    yield from money_balances(columns, dt_h)


def energy_balances(columns: Columns, dt_h: float) -> Iterator[Balance]:
    """Balance the meters against PV, load and battery, and sales against homes, consumers and facilities. [kWh]"""
    export, imports = _exports(columns), _imports(columns)
    beyond_meter = columns["pv_kw"] - columns["load_kw"] - columns["battery_kw"] - columns["injection_kw"]
    demand, facilities = columns["demand_kw"] * dt_h, columns["facility_kw"].sum(-1) * dt_h
    scale = np.maximum(np.abs(demand) + facilities + np.abs(beyond_meter).sum(-1) * dt_h, 1.0)

    def balance(name: str, residual: Floats) -> Balance:
        return Balance(name, residual, scale)

    yield balance("exports", (columns["export_kw"] - export.sum(-1)) * dt_h)
    yield balance("demand = consumers + imports", demand - (columns["consumer_kw"] + imports.sum(-1)) * dt_h)
    supply = facilities + (columns["unserved_kw"] + columns["export_kw"] - columns["curtailed_kw"]) * dt_h
    yield balance("facilities + unserved = demand - exports + curtailed", supply - demand)
    curtailed, unserved = np.maximum(beyond_meter, 0.0).sum(-1), np.maximum(-beyond_meter, 0.0).sum(-1)
    yield balance("curtailed at meters", (curtailed - columns["home_curtailed_kw"]) * dt_h)
    yield balance("unserved at meters", (unserved - columns["home_unserved_kw"]) * dt_h)


def money_balances(columns: Columns, dt_h: float) -> Iterator[Balance]:
    """Balance bills, payments, revenue and profit against energy and prices. [$]"""
    buy, sell = columns["buy_price"], columns["sell_price"]
    bill, revenue, payments = columns["bill"], columns["revenue"], columns["payments"]
    cost, lost_load_cost = columns["facility_cost"].sum(-1), columns["lost_load_cost"]
    scale = np.maximum(np.abs(revenue) + np.abs(payments) + np.abs(cost) + np.abs(lost_load_cost), 1.0)

    def balance(name: str, residual: Floats) -> Balance:
        return Balance(name, residual, scale)

    expected = _imports(columns) * (sell * dt_h)[:, None] - _exports(columns) * (buy * dt_h)[:, None]
    yield balance("bills", np.abs(bill - expected).max(-1, initial=0.0))
    yield balance("payments", payments - columns["export_kw"] * buy * dt_h)
    yield balance("revenue", revenue - columns["demand_kw"] * dt_h * sell)
    received = bill.sum(-1) + columns["consumer_kw"] * sell * dt_h
    yield balance("bills + consumers = revenue - payments", received - revenue + payments)
    yield balance("profit", columns["profit"] - (revenue - cost - payments - lost_load_cost))


def _exports(columns: Columns) -> Floats:
    """(slot, home) [kW]"""
    exports: Floats = np.maximum(columns["injection_kw"], 0.0)
    return exports


def _imports(columns: Columns) -> Floats:
    """(slot, home) [kW]"""
    imports: Floats = np.maximum(-columns["injection_kw"], 0.0)
    return imports
