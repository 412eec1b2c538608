"""Speeds, pausing and stepping, with the time as an argument."""

from __future__ import annotations

from zengrid_clock.pace import Pace


def test_at_full_speed_the_next_slot_is_always_due() -> None:
    pace = Pace(slot_s=3600, speed=0, deadline_s=2)
    assert pace.wait_s(0.0) is None
    pace.start(10.0)
    for now in (10.0, 10.001, 10.002):
        assert pace.wait_s(now) == 0.0
        pace.began(now)
        pace.finished()
    assert pace.deadline_s == 2


def test_slots_keep_the_beat_and_do_not_hurry_after_a_delay() -> None:
    pace = Pace(slot_s=3600, speed=3600, deadline_s=2)
    pace.start(0.0)
    assert pace.deadline_s == 0.5
    pace.began(0.0)
    assert pace.wait_s(0.25) == 0.75
    pace.began(1.0)
    assert pace.wait_s(1.0) == 1.0
    pace.began(7.5)
    assert pace.wait_s(7.5) == 0.0
    pace.began(7.5)
    assert pace.wait_s(7.5) == 1.0


def test_a_pause_holds_and_steps_run_out() -> None:
    pace = Pace(slot_s=900, speed=0, deadline_s=2)
    pace.start(0.0)
    pace.pause()
    assert pace.wait_s(1.0) is None
    pace.step(2, 1.0)
    for _ in range(2):
        assert pace.wait_s(1.0) == 0.0
        pace.began(1.0)
        pace.finished()
    assert pace.state == "paused"
    pace.start(2.0)
    assert pace.wait_s(2.0) == 0.0


def test_a_new_speed_counts_from_now() -> None:
    pace = Pace(slot_s=60, speed=1, deadline_s=2)
    pace.start(0.0)
    pace.began(0.0)
    assert pace.wait_s(0.0) == 60
    pace.set_speed(60, 5.0)
    assert pace.wait_s(5.0) == 1.0
    pace.set_speed(0, 5.5)
    assert pace.wait_s(5.5) == 0.0


def test_a_market_that_has_ended_stays_ended() -> None:
    pace = Pace(slot_s=60, speed=0, deadline_s=2)
    pace.end()
    pace.start(0.0)
    pace.pause()
    assert pace.state == "ended"
    assert pace.wait_s(0.0) is None
