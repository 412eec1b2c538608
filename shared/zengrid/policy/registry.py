"""Policies by name: what ``--policy`` accepts."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, TypeVar

from zengrid.errors import PolicyError
from zengrid.policy.facts import MarketFacts
from zengrid.policy.prices import price_steps
from zengrid.policy.rules import Conventional, FixedPrice, Idle, RandomCommands, RandomPrice, TimeOfUse
from zengrid.policy.seed import read_seed
from zengrid.policy.views import GridPolicy, ProsumerPolicy

if TYPE_CHECKING:
    from zengrid.policy.optimum import Options

P = TypeVar("P")

SUFFIX = ".safetensors"
"""Of files that hold a trained policy."""


class Rule(NamedTuple, Generic[P]):
    """How a name becomes a policy."""

    read: Callable[[str], Any]
    """Reads what stands behind the colon; raises PolicyError where that is wrong whatever the market."""
    make: Callable[[MarketFacts, Any], P]
    """Takes what was read."""


def _nothing(text: str) -> None:
    """For policies that are complete with their name; ``_read`` refuses a colon."""


def _read_optimum(text: str) -> Options:
    from zengrid.policy.optimum import read_options  # an agent that follows a rule needs no dynamic programming

    return read_options(text)


def _optimum(facts: MarketFacts, options: Options) -> ProsumerPolicy:
    from zengrid.policy.optimum import make_optimum

    return make_optimum(facts, options)


def _trained_prosumer(facts: MarketFacts, nothing: None) -> ProsumerPolicy:
    from zengrid.policy import trained  # an agent that follows a rule reads no files
    from zengrid.policy.network import ProsumerNetwork

    file = trained.for_prosumer(facts).file
    return Conventional() if file is None else ProsumerNetwork(file, facts)


def _generic(facts: MarketFacts, nothing: None) -> ProsumerPolicy:
    from zengrid.policy import trained
    from zengrid.policy.network import ProsumerNetwork

    return ProsumerNetwork(trained.load(trained.GENERIC), facts)


def _trained_grid(facts: MarketFacts, nothing: None) -> GridPolicy:
    from zengrid.policy import trained
    from zengrid.policy.network import GridNetwork

    file = trained.for_grid(facts).file
    return _fixed(facts, None) if file is None else GridNetwork(file, facts)


def _read_price(text: str) -> float | None:
    try:
        return float(text) if text else None
    except ValueError:
        raise PolicyError(f"{text!r} is not a price") from None


def _fixed(facts: MarketFacts, price: float | None) -> GridPolicy:
    if price is None:
        # The market's price without demand response, if the grid may set it.
        price = facts.baseline_buy_price
        if not any(abs(level - price) <= 1e-9 for level in facts.buy_prices):
            price = min(facts.buy_prices)
    return FixedPrice(facts, price)


def _read_schedule(text: str) -> str:
    price_steps(text)
    return text


_PROSUMER: dict[str, Rule[ProsumerPolicy]] = {
    "trained": Rule(_nothing, _trained_prosumer),
    "generic": Rule(_nothing, _generic),
    "conventional": Rule(_nothing, lambda facts, nothing: Conventional()),
    "idle": Rule(_nothing, lambda facts, nothing: Idle()),
    "random": Rule(read_seed, RandomCommands),
    "optimum": Rule(_read_optimum, _optimum),
}
_GRID: dict[str, Rule[GridPolicy]] = {
    "trained": Rule(_nothing, _trained_grid),
    "fixed": Rule(_read_price, _fixed),
    "tou": Rule(_read_schedule, TimeOfUse),
    "random": Rule(read_seed, RandomPrice),
}
PROSUMER_POLICIES = tuple(_PROSUMER)
GRID_POLICIES = tuple(_GRID)


def prosumer_policy_files(text: str) -> tuple[str, ...]:
    """The files that a prosumer's policy would read beside those that come with zengrid.

    Raises
    ------
    PolicyError
        Where there is no such policy, or what stands behind its colon is wrong whatever the market.
    """
    if text.endswith(SUFFIX):
        return (text,)
    read = _read(text, _PROSUMER, "prosumer")[1]
    return read.files if text.startswith("optimum") else ()


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


def _make(text: str, facts: MarketFacts, known: dict[str, Rule[P]], role: str) -> P:
    rule, read = _read(text, known, role)
    try:
        return rule.make(facts, read)
    except PolicyError as error:
        raise PolicyError(f"policy = {text}: {error}") from None


def _read(text: str, known: dict[str, Rule[P]], role: str) -> tuple[Rule[P], Any]:
    """The rule that a text names, and what it has read behind the colon."""
    name, colon, rest = text.partition(":")
    if name not in known:
        raise PolicyError(f"policy = {text}: a {role} can play {', '.join(known)}, or a *{SUFFIX} file")
    rule = known[name]
    if colon and rule.read is _nothing:
        raise PolicyError(f"policy = {text}: {name} takes nothing after its name")
    try:
        return rule, rule.read(rest)
    except PolicyError as error:
        raise PolicyError(f"policy = {text}: {error}") from None
