"""Latencies: percentiles of the recent slots, histograms of all."""

from __future__ import annotations

import numpy as np

from zengrid_clock.latencies import BOUNDS_MS, WINDOW, Latencies


def test_latencies_are_zero_before_the_first_slot() -> None:
    empty = Latencies().summary()
    assert empty.price_p99_ms == 0.0
    assert sum(empty.price.counts) == 0


def test_every_slot_is_counted_once() -> None:
    latencies, rng = Latencies(), np.random.default_rng(1)
    times = rng.exponential(0.004, (3 * WINDOW + 77, 3))
    for number, (price, battery, commit) in enumerate(times.tolist()):
        latencies.add(price, battery, commit, float(number))
        if number % 700 == 0:
            latencies.summary()  # somebody looks in between
    summary = latencies.summary()
    for column, histogram in enumerate((summary.price, summary.battery, summary.commit)):
        classes, _ = np.histogram(times[:, column] * 1e3, bins=[-np.inf, *BOUNDS_MS, np.inf])
        assert histogram.counts == tuple(classes)
        assert np.isclose(histogram.sum_ms, times[:, column].sum() * 1e3)
    assert np.isclose(summary.battery_p50_ms, np.median(times[-WINDOW:, 1]) * 1e3)
