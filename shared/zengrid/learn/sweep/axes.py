"""What may be varied: any field of a scenario, any learning setting, the preset, and what agents see."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from difflib import get_close_matches
from itertools import product
from typing import Any, get_args

from zengrid.core.observe import ObservationKind
from zengrid.errors import PolicyError
from zengrid.learn.settings import KINDS, Learning, Settings
from zengrid.learn.sweep.cell import Cell
from zengrid.scenario import Days, Scenario

OBSERVATIONS: tuple[str, ...] = get_args(ObservationKind)


def cells(
    scenario: Scenario,
    axes: Mapping[str, Sequence[Any]],
    changes: Mapping[str, Any] | None = None,
    preset: str = "fast",
    observation: str = "public",
) -> list[Cell]:
    """Every combination of values, checked.

    Parameters
    ----------
    scenario:
        What is varied.
    axes:
        Values by path: ``{"homes.*.battery.capacity_kwh": [2, 4], "grid_lr": [1e-3, 1e-4]}``.
    changes:
        Values that are the same for all, by path.
    preset, observation:
        Where they are not varied themselves.

    Raises
    ------
    ScenarioError, PolicyError
        Name the field or setting, the value and what is permitted.
    """
    for path, values in axes.items():
        if not values:
            raise PolicyError(f"{path}: no values; needed: one or more")
        if len({repr(value) for value in values}) < len(values):
            raise PolicyError(f"{path} = {', '.join(map(str, values))}: a value stands there twice; permitted: once")
    same = {"preset": preset, "observation": observation, **(changes or {})}
    return [_cell(scenario, same, dict(zip(axes, values, strict=True))) for values in product(*axes.values())]


def _cell(scenario: Scenario, same: Mapping[str, Any], values: Mapping[str, Any]) -> Cell:
    all_values = {**same, **values}
    preset, observation = all_values.pop("preset"), all_values.pop("observation")
    if observation not in OBSERVATIONS:
        raise PolicyError(f"observation = {observation}: permitted: {', '.join(OBSERVATIONS)}")
    in_scenario = {path: value for path, value in all_values.items() if path.split(".")[0] in Scenario.model_fields}
    in_settings = {name: value for name, value in all_values.items() if name not in in_scenario}
    for name in in_settings:
        _known(name)
    settings = Settings.preset(preset).with_(**in_settings)
    varied = scenario.with_(**in_scenario) if in_scenario else scenario
    Days(varied)  # says at once what its data lacks
    return Cell(values, varied, settings, observation)


def _known(name: str) -> None:
    """Refuse what is neither a field nor a setting, with a guess at what was meant."""
    deep = [field.name for field in fields(Learning)]
    settings = [field.name for field in fields(Settings) if field.name not in KINDS]
    settings += [*deep, *(f"{kind}_{setting}" for kind in KINDS for setting in deep)]
    if name in settings:
        return
    everything = [*settings, "preset", "observation", *Scenario.model_fields]
    close = get_close_matches(name.split(".")[0], everything, n=1)
    guess = f"; did you mean {close[0]}?" if close else ""
    plain = ", ".join(settings[: -len(KINDS) * len(deep)])
    raise PolicyError(
        f"{name}: no field of a scenario and no learning setting{guess}. Permitted: preset, observation; the settings "
        f"{plain}, those of a learner also with grid_ or prosumer_ before them; "
        f"the path of a field that begins with {', '.join(Scenario.model_fields)}"
    )
