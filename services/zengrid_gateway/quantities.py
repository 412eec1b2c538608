"""From named quantities to the observations of a policy: what is not named is as it is now."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from zengrid.core.observe import ObservationKind, grid_features, prosumer_features
from zengrid.wire.queries import Status
from zengrid_gateway.invalid import short, shown

NUMBERS = 200_000
"""Most numbers in all observations together."""


class QuantityError(ValueError):
    """A quantity that cannot be used: which, its value, and what is allowed."""

    def __init__(self, name: str, value: object, allowed: str) -> None:
        super().__init__(f"{short(name)} = {shown(value)}: {allowed}")
        self.name = name
        self.value = value
        self.allowed = allowed


def candidates(status: Status, role: str) -> list[tuple[str, ...]]:
    """The features that an agent's policy may want, the usual ones first."""
    kinds: tuple[ObservationKind, ...] = ("public", "paper")
    if role == "prosumer":
        return [prosumer_features(kind) for kind in kinds]
    facilities = 0 if status.last is None else len(status.last.facility_kw)
    homes = 0 if status.homes is None else len(status.homes.homes)
    return [grid_features(kind, facilities, homes) for kind in kinds]


def present(status: Status, agent: str, home: str | None) -> dict[str, float]:
    """Every quantity that a policy may ask for, as it is now."""
    last, homes = status.last, status.homes
    if last is None or homes is None:
        return {}
    now = {
        "hour": (status.slot * status.dt_h) % 24.0,
        "buy_price": last.buy_price,
        "sell_price": last.sell_price,
        "demand_kw": last.demand_kw,
        "homes": float(len(homes.homes)),
    }
    for i, cost in enumerate(last.facility_cost.tolist()):
        now[f"facility_cost_{i + 1}"] = cost
    payments = [max(power, 0.0) * last.buy_price * last.dt_h for power in homes.injection_kw.tolist()]
    now |= {f"payment_{j + 1}": payment for j, payment in enumerate(payments)}
    now["payments"] = sum(payments)
    mine = [i for i, name in enumerate(homes.agents) if name == agent and home in (None, homes.homes[i])]
    if mine:
        now |= {name: float(getattr(homes, name)[mine[0]]) for name in ("soc", "pv_kw", "load_kw")}
    return now


def observations(
    features: Sequence[str], given: Mapping[str, float | Sequence[float]], now: Mapping[str, float]
) -> tuple[tuple[float, ...], ...]:
    """One row for each value of the lists, which have one length; numbers count for all rows.

    Raises
    ------
    QuantityError
        A name that the policy does not ask for, lists of different lengths or too long, or no present value.
    """
    names = [name for name in features if name not in ("time_sin", "time_cos")]
    names += ["hour"] if "time_sin" in features else []
    known = set(names)
    for name, value in given.items():
        if name not in known:
            raise QuantityError(name, value, f"this policy looks at {', '.join(names)}")
    lengths = {name: len(value) for name, value in given.items() if not isinstance(value, float | int)}
    rows = max(lengths.values(), default=1)
    for name, length in lengths.items():
        if length != rows:
            raise QuantityError(name, f"{length} values", f"lists must have one length; the longest has {rows}")
        if rows * len(features) > NUMBERS:
            raise QuantityError(
                name, f"{length} values", f"{NUMBERS // len(features)} at most for {len(features)} features"
            )
    columns = {}
    for name in names:
        if name not in given and name not in now:
            raise QuantityError(name, "missing", "has no present value, since no slot is settled: give one")
        value = given[name] if name in given else now[name]
        columns[name] = [float(value)] * rows if isinstance(value, float | int) else [float(each) for each in value]
    if "hour" in columns:
        angles = [2.0 * math.pi * hour / 24.0 for hour in columns["hour"]]
        columns |= {"time_sin": [math.sin(a) for a in angles], "time_cos": [math.cos(a) for a in angles]}
    return tuple(zip(*(columns[name] for name in features), strict=True))
