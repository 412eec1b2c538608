"""A change to the market is applied at once between two slots, and otherwise after the slot, in order."""

from __future__ import annotations

from zengrid_clock.between_slots import CHANGES_LIMIT, BetweenSlots


def test_a_change_between_two_slots_is_applied_at_once() -> None:
    applied: list[str] = []
    assert BetweenSlots().apply(lambda: applied.append("now"))
    assert applied == ["now"]


def test_changes_during_a_slot_wait_for_its_end_in_order() -> None:
    between, applied = BetweenSlots(), list[int]()
    between.close()
    for number in range(3):
        assert not between.apply(lambda number=number: applied.append(number))  # type: ignore[misc]
    assert between.has_changes
    assert applied == []
    for change in between.open():
        change()
    assert applied == [0, 1, 2]
    assert not between.has_changes
    assert between.open() == []


def test_the_number_of_waiting_changes_is_bounded() -> None:
    between = BetweenSlots()
    between.close()
    for _ in range(CHANGES_LIMIT):
        assert not between.is_full
        between.apply(lambda: None)
    assert between.is_full
