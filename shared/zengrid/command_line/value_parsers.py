"""Parsers of option values. Each raises an error that says what is permitted; the parser adds option and value."""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass

MAX_SPEED = 1e9


def parse_speed(text: str) -> float:
    """Parse a speed: ``max`` gives 0, ``60x`` or ``60`` gives 60. [times real time]"""
    if text == "max":
        return 0.0
    speed = _parse_float(text.removesuffix("x"))
    if not 0 < speed <= MAX_SPEED:
        raise argparse.ArgumentTypeError("permitted: max, or a factor on real time such as 60x, 1x or 0.5x")
    return speed


def parse_integer(text: str) -> int:
    """Parse any whole number, such as a seed."""
    try:
        return int(text)
    except ValueError:
        raise argparse.ArgumentTypeError("permitted: a whole number") from None


@dataclass(frozen=True, slots=True)
class WholeNumber:
    """Parses whole numbers from ``low`` to ``high``, or without an upper limit."""

    low: int
    high: int | None = None

    def __call__(self, text: str) -> int:
        """Parse a number."""
        number = int(text) if text.isascii() and text.isdecimal() else self.low - 1
        if number < self.low or (self.high is not None and number > self.high):
            limits = self.limits or f"from {self.low} up"
            raise argparse.ArgumentTypeError(f"permitted: a whole number {limits}")
        return number

    @property
    def limits(self) -> str:
        """The permitted range for the help, if it has an upper limit."""
        return "" if self.high is None else f"{self.low} to {self.high}"


@dataclass(frozen=True, slots=True)
class Number:
    """Parses finite numbers.

    Parameters
    ----------
    low:
        Lower limit.
    above:
        Whether numbers must be above the lower limit, not equal to it.
    high:
        Upper limit, which is permitted; infinity for none.
    unit:
        Unit of the number in errors and in the help.
    """

    low: float = 0.0
    above: bool = False
    high: float = math.inf
    unit: str = ""

    def __call__(self, text: str) -> float:
        """Parse a number."""
        number = _parse_float(text)
        if not self.low <= number <= self.high or math.isinf(number) or (self.above and number == self.low):
            low = self._with_unit(self.low)
            limits = self.limits or (f"above {low}" if self.above else f"from {low} up")
            raise argparse.ArgumentTypeError(f"permitted: a number {limits}")
        return number

    @property
    def limits(self) -> str:
        """The permitted range for the help, if it has an upper limit."""
        if math.isinf(self.high):
            return ""
        return f"{'above' if self.above else 'from'} {self.low:g} up to {self._with_unit(self.high)}"

    def _with_unit(self, number: float) -> str:
        return f"{number:g} {self.unit}".rstrip()


def _parse_float(text: str) -> float:
    """The number, or NaN if the text is no number."""
    try:
        return float(text)
    except ValueError:
        return math.nan
