"""``NAME=VALUE`` on a command line, such as a field of a scenario or a learning setting."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from zengrid.errors import PolicyError


def parse_assignments(texts: Sequence[str]) -> dict[str, Any]:
    """Parse ``["lr=1e-3"]`` to ``{"lr": 0.001}``; values are read as YAML.

    Raises
    ------
    PolicyError
        If a text has no ``=``.
    """
    import yaml

    found: dict[str, Any] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals:
            raise PolicyError(f"{text}: permitted: NAME=VALUE")
        try:
            found[name] = float(value)
            if found[name].is_integer() and not set(value) & set(".eE"):
                found[name] = int(value)
        except ValueError:
            found[name] = yaml.safe_load(value)
        if isinstance(found[name], list):
            found[name] = tuple(found[name])
    return found
