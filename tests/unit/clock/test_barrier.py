"""The barrier counts the first valid action of each expected agent, whatever else arrives."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from zengrid.errors import WireError
from zengrid_clock.barrier import ActionRefused, PhaseBarrier, SlotPhase

NOW = SlotPhase(2, 5, "price")


def says(value: float, phase: SlotPhase = NOW) -> Callable[[], tuple[SlotPhase, float]]:
    return lambda: (phase, value)


def test_is_done_when_all_awaited_for_have_answered() -> None:
    barrier: PhaseBarrier[float] = PhaseBarrier(NOW, ["a", "b", "slow"], ["a", "b"])
    barrier.offer("a", says(1.0))
    assert not barrier.is_complete
    barrier.offer("b", says(2.0))
    assert barrier.is_complete
    barrier.offer("slow", says(3.0))
    assert barrier.actions == {"a": 1.0, "b": 2.0, "slow": 3.0}


def test_without_anyone_to_wait_for_it_is_done_at_once() -> None:
    assert PhaseBarrier(NOW, ["a"], []).is_complete


@pytest.mark.parametrize(
    ("phase", "cause"),
    [
        (SlotPhase(2, 4, "battery"), "late"),
        (SlotPhase(1, 23, "price"), "late"),
        (SlotPhase(2, 5, "battery"), "future"),
        (SlotPhase(3, 0, "price"), "future"),
    ],
)
def test_other_phases_are_refused(phase: SlotPhase, cause: str) -> None:
    barrier: PhaseBarrier[float] = PhaseBarrier(NOW, ["a"], ["a"])
    with pytest.raises(ActionRefused) as refused:
        barrier.offer("a", says(1.0, phase))
    assert refused.value.cause == cause
    assert not barrier.is_complete


def test_only_the_first_counts_and_a_flood_is_not_even_read() -> None:
    barrier: PhaseBarrier[float] = PhaseBarrier(NOW, ["a"], ["a"])
    barrier.offer("a", says(1.0))

    def never_read() -> tuple[SlotPhase, float]:
        raise AssertionError("a duplicate must not be decoded")

    with pytest.raises(ActionRefused, match="duplicate"):
        barrier.offer("a", never_read)
    assert barrier.actions == {"a": 1.0}


def test_strangers_and_nonsense_are_refused() -> None:
    def nonsense() -> tuple[SlotPhase, float]:
        raise WireError("no JSON")

    barrier: PhaseBarrier[float] = PhaseBarrier(NOW, ["a"], ["a"])
    with pytest.raises(ActionRefused, match="foreign"):
        barrier.offer("b", says(1.0))
    with pytest.raises(ActionRefused, match="malformed"):
        barrier.offer("a", nonsense)
    barrier.offer("a", says(1.0))
    assert barrier.is_complete


def test_gives_up_those_who_are_gone_but_keeps_their_answer() -> None:
    barrier: PhaseBarrier[float] = PhaseBarrier(NOW, ["a", "b"], ["a", "b"])
    barrier.offer("a", says(1.0))
    assert not barrier.drop("a")
    assert barrier.drop("b")
    assert barrier.is_complete
    assert barrier.actions == {"a": 1.0}


@given(
    st.lists(st.tuples(st.sampled_from("abcdx"), st.sampled_from(["ok", "late", "future", "bad", "gone"])), max_size=40)
)
def test_any_order_of_events_leaves_only_valid_first_answers(events: list[tuple[str, str]]) -> None:
    barrier: PhaseBarrier[int] = PhaseBarrier(NOW, "abcd", "abc")
    first: dict[str, int] = {}
    gone = set()
    for number, (agent, kind) in enumerate(events):
        if kind == "gone":
            barrier.drop(agent)
            gone.add(agent)
            continue
        phase = {"late": SlotPhase(0, 0, "price"), "future": SlotPhase(9, 0, "price")}.get(kind, NOW)

        def read(value: int = number, kind: str = kind, phase: SlotPhase = phase) -> tuple[SlotPhase, int]:
            if kind == "bad":
                raise WireError("bad")
            return phase, value

        try:
            barrier.offer(agent, read)
        except ActionRefused:
            continue
        first.setdefault(agent, number)
    assert barrier.actions == first
    assert set(first) <= set("abcd")
    assert barrier.is_complete == (set("abc") <= set(first) | gone)
