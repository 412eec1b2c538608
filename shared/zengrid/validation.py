"""Describes invalid input for an error message: the path of the field, its value shortened, and what is wrong."""

from __future__ import annotations

import reprlib
from collections.abc import Iterable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pydantic import ValidationError

FieldPath = tuple[str | int, ...]
"""Names of fields and positions in lists, from the outside in, such as ``("homes", 0, "pv_kw")``."""
VALUE_MAX = 60
"""Most characters of a value that an error message shows."""

_SHORT = reprlib.Repr()
_SHORT.maxstring = _SHORT.maxother = VALUE_MAX


def field_name(path: Iterable[str | int]) -> str:
    """The path of a field as one name, such as ``homes.0.pv_kw``."""
    return ".".join(map(str, path))


def short_value(value: object) -> str:
    """``repr`` of a value in at most ``VALUE_MAX`` characters; large values are never rendered as a whole."""
    text = _SHORT.repr(value)
    return text if len(text) <= VALUE_MAX else f"{text[: VALUE_MAX - 3]}..."


def first_error(error: ValidationError) -> str:
    """The first error that pydantic found, as one line: field, value, what is wrong."""
    first = error.errors(include_url=False, include_context=False)[0]
    message = first["msg"].removeprefix("Value error, ")
    return f"{field_name(first['loc']) or 'message'} = {short_value(first['input'])}: {message}"
