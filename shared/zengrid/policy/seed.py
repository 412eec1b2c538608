"""Seeds as people write them behind a policy's name."""

from __future__ import annotations

from zengrid.errors import PolicyError, brief

MOST = 2**63 - 1


def read_seed(text: str) -> int:
    """``7``, ``seed=7``, or nothing for 0; raises PolicyError where it is no seed."""
    digits = text.removeprefix("seed=")
    if not digits:
        return 0
    if not (digits.isascii() and digits.isdecimal() and len(digits) <= len(str(MOST)) and int(digits) <= MOST):
        raise PolicyError(f"seed = {brief(digits)}: permitted is a whole number from 0 up to {MOST}")
    return int(digits)
