"""What the agents decide in every peer: the rules ``tou`` and ``conventional`` of zengrid, on plain Python numbers.

Agents' processes import this module and nothing of zengrid, so that they start as fast as the peer allows.
"""

from __future__ import annotations

from collections.abc import Sequence

PROSUMER_POLICY = "conventional"
GRID_POLICY = "tou:0.05,18:00=0.09,22:00=0.06"
"""The same rules as ``zengrid up`` takes them."""
BUY_PRICES = [0.05] * 18 + [0.09] * 4 + [0.06] * 2
"""What ``GRID_POLICY`` pays in each hour of the day. [$/kWh]"""


def buy_price(observation: Sequence[float]) -> float:
    """Price at which the grid buys in this slot. [$/kWh]

    Parameters
    ----------
    observation:
        Slot of the day [-], demand [kW] and payments for exports [$] of the last slot, sell price [$/kWh].
    """
    return BUY_PRICES[int(observation[0])]


def battery_kw(buy_price: float, observation: Sequence[float]) -> float:
    """Command to a home's battery, > 0 charges. [kW]

    Parameters
    ----------
    buy_price:
        Price at which the grid buys in this slot; the rule does not need it, but every home waits for it. [$/kWh]
    observation:
        State of charge [-], PV [kW], load [kW], largest charging and discharging power [kW].
    """
    _, pv_kw, load_kw, charge_max_kw, discharge_max_kw = observation
    return min(max(pv_kw - load_kw, -discharge_max_kw), charge_max_kw)
