"""A rate limit lets bursts through, holds the rate in the long run, and forgets whom it has not seen for long."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from zengrid.rate_limit import CLIENTS, RateLimit


def test_a_rate_of_zero_never_waits() -> None:
    limit = RateLimit(0.0)
    assert [limit.wait_s("a", 0.0) for _ in range(1000)] == [0.0] * 1000


def test_a_burst_passes_and_then_the_rate_holds() -> None:
    limit = RateLimit(10.0, burst_s=2.0)
    assert [limit.wait_s("a", 0.0) for _ in range(20)] == [0.0] * 20
    assert limit.wait_s("a", 0.0) == 0.1
    assert limit.wait_s("b", 0.0) == 0.0
    assert limit.wait_s("a", 0.1) == 0.0


@given(
    st.floats(0.5, 1000.0),
    st.floats(0.1, 10.0),
    st.lists(st.floats(0.0, 2.0), min_size=1, max_size=200),
)
def test_a_client_never_gets_more_than_burst_and_rate(per_s: float, burst_s: float, gaps: list[float]) -> None:
    limit = RateLimit(per_s, burst_s)
    now, passed = 0.0, 0
    for gap in gaps:
        now += gap
        passed += limit.wait_s("a", now) == 0.0
    assert passed <= max(per_s * burst_s, 1.0) + per_s * now + 1e-6


def test_the_number_of_remembered_clients_is_bounded() -> None:
    limit = RateLimit(1.0, burst_s=1.0)
    for i in range(CLIENTS + 10):
        limit.wait_s(str(i), 0.0)
    assert len(limit._buckets) == CLIENTS
    assert limit.wait_s("0", 0.0) == 0.0
    assert limit.wait_s(str(CLIENTS + 9), 0.0) > 0.0
