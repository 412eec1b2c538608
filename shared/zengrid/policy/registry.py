"""Policies by name: what ``--policy`` accepts."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from zengrid.core.baselines import CONVENTIONAL_BUY_PRICE
from zengrid.errors import PolicyError
from zengrid.policy.facts import MarketFacts
from zengrid.policy.rules import Conventional, FixedPrice, Idle, RandomCommands, RandomPrice, TimeOfUse
from zengrid.policy.views import GridPolicy, ProsumerPolicy

P = TypeVar("P")

_PROSUMER: dict[str, Callable[[MarketFacts, str], ProsumerPolicy]] = {
    "conventional": lambda facts, text: Conventional(),
    "idle": lambda facts, text: Idle(),
    "random": lambda facts, text: RandomCommands(facts, _number(text, int, 0)),
}
_GRID: dict[str, Callable[[MarketFacts, str], GridPolicy]] = {
    "fixed": lambda facts, text: FixedPrice(facts, _number(text, float, CONVENTIONAL_BUY_PRICE)),
    "tou": lambda facts, text: TimeOfUse(facts, text),
    "random": lambda facts, text: RandomPrice(facts, _number(text, int, 0)),
}
PROSUMER_POLICIES = tuple(_PROSUMER)
GRID_POLICIES = tuple(_GRID)


def make_prosumer_policy(text: str, facts: MarketFacts) -> ProsumerPolicy:
    """The policy that a text such as ``conventional``, ``random:7`` or ``trained.safetensors`` names.

    Raises
    ------
    PolicyError
        Where there is no such policy, or it does not fit the market.
    """
    return _make(text, facts, _PROSUMER, "prosumer")


def make_grid_policy(text: str, facts: MarketFacts) -> GridPolicy:
    """The policy that a text such as ``fixed:0.07``, ``tou:0.05,18:00=0.09`` or ``trained.safetensors`` names."""
    return _make(text, facts, _GRID, "grid")


def _make(text: str, facts: MarketFacts, known: dict[str, Callable[[MarketFacts, str], P]], role: str) -> P:
    name, _, rest = text.partition(":")
    if name not in known:
        raise PolicyError(f"policy = {text}: a {role} can play {', '.join(known)}, or a *.safetensors file")
    return known[name](facts, rest)


def _number(text: str, kind: Callable[[str], P], default: P) -> P:
    try:
        return kind(text) if text else default
    except ValueError:
        raise PolicyError(f"{text!r} is not a number") from None
