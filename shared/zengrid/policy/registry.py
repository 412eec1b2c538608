"""Policies by name: what ``--policy`` accepts."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from zengrid.core.baselines import BASELINE_BUY_PRICE
from zengrid.errors import PolicyError
from zengrid.policy.facts import MarketFacts
from zengrid.policy.rules import Conventional, FixedPrice, Idle, RandomCommands, RandomPrice, TimeOfUse
from zengrid.policy.views import GridPolicy, ProsumerPolicy

P = TypeVar("P")

SUFFIX = ".safetensors"
"""Of files that hold a trained policy."""


def _optimum(facts: MarketFacts, text: str) -> ProsumerPolicy:
    from zengrid.policy.optimum import make_optimum  # an agent that follows a rule needs no dynamic programming

    return make_optimum(facts, text)


def _trained_prosumer(facts: MarketFacts, text: str) -> ProsumerPolicy:
    from zengrid.policy import trained  # an agent that follows a rule reads no files
    from zengrid.policy.network import ProsumerNetwork

    file = trained.for_prosumer(facts).file
    return Conventional() if file is None else ProsumerNetwork(file, facts)


def _generic(facts: MarketFacts, text: str) -> ProsumerPolicy:
    from zengrid.policy import trained
    from zengrid.policy.network import ProsumerNetwork

    return ProsumerNetwork(trained.load(trained.GENERIC), facts)


def _trained_grid(facts: MarketFacts, text: str) -> GridPolicy:
    from zengrid.policy import trained
    from zengrid.policy.network import GridNetwork

    file = trained.for_grid(facts).file
    return FixedPrice(facts, _price("", facts)) if file is None else GridNetwork(file, facts)


_PROSUMER: dict[str, Callable[[MarketFacts, str], ProsumerPolicy]] = {
    "trained": _trained_prosumer,
    "generic": _generic,
    "conventional": lambda facts, text: Conventional(),
    "idle": lambda facts, text: Idle(),
    "random": lambda facts, text: RandomCommands(facts, _seed(text)),
    "optimum": _optimum,
}
_GRID: dict[str, Callable[[MarketFacts, str], GridPolicy]] = {
    "trained": _trained_grid,
    "fixed": lambda facts, text: FixedPrice(facts, _price(text, facts)),
    "tou": TimeOfUse,
    "random": lambda facts, text: RandomPrice(facts, _seed(text)),
}
_PLAIN = ("trained", "generic", "conventional", "idle")
PROSUMER_POLICIES = tuple(_PROSUMER)
GRID_POLICIES = tuple(_GRID)


def make_prosumer_policy(text: str, facts: MarketFacts) -> ProsumerPolicy:
    """The policy that a text such as ``conventional``, ``random:7`` or ``trained.safetensors`` names.

    Raises
    ------
    PolicyError
        Where there is no such policy, or it does not fit the market.
    """
    if text.endswith(SUFFIX):
        from zengrid.policy.network import ProsumerNetwork

        return ProsumerNetwork.load(text, facts)
    return _make(text, facts, _PROSUMER, "prosumer")


def make_grid_policy(text: str, facts: MarketFacts) -> GridPolicy:
    """The policy that a text such as ``fixed:0.07``, ``tou:0.05,18:00=0.09`` or ``trained.safetensors`` names.

    Raises
    ------
    PolicyError
        Where there is no such policy, or it does not fit the market.
    """
    if text.endswith(SUFFIX):
        from zengrid.policy.network import GridNetwork

        return GridNetwork.load(text, facts)
    return _make(text, facts, _GRID, "grid")


def _make(text: str, facts: MarketFacts, known: dict[str, Callable[[MarketFacts, str], P]], role: str) -> P:
    name, colon, rest = text.partition(":")
    if name not in known:
        raise PolicyError(f"policy = {text}: a {role} can play {', '.join(known)}, or a *{SUFFIX} file")
    if colon and name in _PLAIN:
        raise PolicyError(f"policy = {text}: {name} takes nothing after its name")
    try:
        return known[name](facts, rest)
    except PolicyError as error:
        raise PolicyError(f"policy = {text}: {error}") from None


def _seed(text: str) -> int:
    text = text.removeprefix("seed=")
    if text and not text.isdecimal():
        raise PolicyError(f"seed = {text}: permitted is a whole number from 0 up")
    return int(text or 0)


def _price(text: str, facts: MarketFacts) -> float:
    if not text:
        # The price of a market without demand response, where it may be set.
        known = any(abs(level - BASELINE_BUY_PRICE) <= 1e-9 for level in facts.buy_prices)
        return BASELINE_BUY_PRICE if known else min(facts.buy_prices)
    try:
        return float(text)
    except ValueError:
        raise PolicyError(f"{text!r} is not a price") from None
