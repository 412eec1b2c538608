"""How long a supervisor waits before it starts a failed process again."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from zengrid.processes import Restarts


@pytest.mark.parametrize(("failures", "wait_s"), [(1, 0.1), (2, 0.2), (3, 0.4), (6, 3.2), (7, 5.0), (1000, 5.0)])
def test_the_wait_doubles_up_to_the_longest(failures: int, wait_s: float) -> None:
    assert Restarts().wait_s(failures) == pytest.approx(wait_s)


@given(failures=st.integers(1, 10_000), first_s=st.floats(1e-3, 1.0), longest_s=st.floats(1.0, 60.0))
def test_the_wait_stays_in_its_bounds_and_never_shrinks(failures: int, first_s: float, longest_s: float) -> None:
    restarts = Restarts(first_s=first_s, longest_s=longest_s)
    assert first_s <= restarts.wait_s(failures) <= restarts.wait_s(failures + 1) <= longest_s
