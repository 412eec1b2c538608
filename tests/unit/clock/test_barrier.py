"""The barrier counts the first valid action of each expected agent, whatever else arrives."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from zengrid.errors import WireError
from zengrid_clock.barrier import Barrier, Moment, Refused

NOW = Moment(2, 5, "price")


def says(value: float, moment: Moment = NOW) -> Callable[[], tuple[Moment, float]]:
    return lambda: (moment, value)


def test_is_done_when_all_waited_for_have_answered() -> None:
    barrier: Barrier[float] = Barrier(NOW, ["a", "b", "slow"], ["a", "b"])
    barrier.offer("a", says(1.0))
    assert not barrier.done
    barrier.offer("b", says(2.0))
    assert barrier.done
    barrier.offer("slow", says(3.0))
    assert barrier.answers == {"a": 1.0, "b": 2.0, "slow": 3.0}


def test_without_anyone_to_wait_for_it_is_done_at_once() -> None:
    assert Barrier(NOW, ["a"], []).done


@pytest.mark.parametrize(
    ("moment", "cause"),
    [
        (Moment(2, 4, "battery"), "late"),
        (Moment(1, 23, "price"), "late"),
        (Moment(2, 5, "battery"), "future"),
        (Moment(3, 0, "price"), "future"),
    ],
)
def test_other_moments_are_refused(moment: Moment, cause: str) -> None:
    barrier: Barrier[float] = Barrier(NOW, ["a"], ["a"])
    with pytest.raises(Refused) as refused:
        barrier.offer("a", says(1.0, moment))
    assert refused.value.cause == cause
    assert not barrier.done


def test_only_the_first_counts_and_a_flood_is_not_even_read() -> None:
    barrier: Barrier[float] = Barrier(NOW, ["a"], ["a"])
    barrier.offer("a", says(1.0))

    def never_read() -> tuple[Moment, float]:
        raise AssertionError("a duplicate must not be decoded")

    with pytest.raises(Refused, match="duplicate"):
        barrier.offer("a", never_read)
    assert barrier.answers == {"a": 1.0}


def test_strangers_and_nonsense_are_refused() -> None:
    def nonsense() -> tuple[Moment, float]:
        raise WireError("no JSON")

    barrier: Barrier[float] = Barrier(NOW, ["a"], ["a"])
    with pytest.raises(Refused, match="foreign"):
        barrier.offer("b", says(1.0))
    with pytest.raises(Refused, match="malformed"):
        barrier.offer("a", nonsense)
    barrier.offer("a", says(1.0))
    assert barrier.done


def test_gives_up_those_who_are_gone_but_keeps_their_answer() -> None:
    barrier: Barrier[float] = Barrier(NOW, ["a", "b"], ["a", "b"])
    barrier.offer("a", says(1.0))
    assert not barrier.give_up("a")
    assert barrier.give_up("b")
    assert barrier.done
    assert barrier.answers == {"a": 1.0}


@given(
    st.lists(st.tuples(st.sampled_from("abcdx"), st.sampled_from(["ok", "late", "future", "bad", "gone"])), max_size=40)
)
def test_any_order_of_events_leaves_only_valid_first_answers(events: list[tuple[str, str]]) -> None:
    barrier: Barrier[int] = Barrier(NOW, "abcd", "abc")
    first: dict[str, int] = {}
    gone = set()
    for number, (agent, kind) in enumerate(events):
        if kind == "gone":
            barrier.give_up(agent)
            gone.add(agent)
            continue
        moment = {"late": Moment(0, 0, "price"), "future": Moment(9, 0, "price")}.get(kind, NOW)

        def read(value: int = number, kind: str = kind, moment: Moment = moment) -> tuple[Moment, int]:
            if kind == "bad":
                raise WireError("bad")
            return moment, value

        try:
            barrier.offer(agent, read)
        except Refused:
            continue
        first.setdefault(agent, number)
    assert barrier.answers == first
    assert set(first) <= set("abcd")
    assert barrier.done == (set("abc") <= set(first) | gone)
