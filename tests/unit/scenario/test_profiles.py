"""Resampling keeps the energy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from zengrid.scenario.profiles import resample

POWERS = st.lists(st.floats(0, 100), min_size=1, max_size=60)
DIVISORS = [n for n in range(1, 289) if 1440 % n == 0]


@given(POWERS, st.integers(1, 60))
def test_energy_is_conserved(powers: list[float], slots: int) -> None:
    given_kw = np.array([powers, powers[::-1]])
    got = resample(given_kw, slots)
    assert got.shape == (2, slots)
    assert got.flags.c_contiguous
    np.testing.assert_allclose(got.mean(axis=-1), given_kw.mean(axis=-1), rtol=1e-9, atol=1e-9)
    assert got.min() >= given_kw.min() - 1e-9
    assert got.max() <= given_kw.max() + 1e-9


@given(st.sampled_from(DIVISORS), st.sampled_from(DIVISORS))
def test_a_constant_stays_constant(parts: int, slots: int) -> None:
    np.testing.assert_allclose(resample(np.full(parts, 3.25), slots), 3.25, rtol=1e-12)


def test_the_same_number_of_parts_changes_no_bit() -> None:
    values = np.random.default_rng(1).random((4, 24))
    np.testing.assert_array_equal(resample(values, 24), values)


@pytest.mark.parametrize(("slots", "wanted"), [(2, [1.5, 3.5]), (8, [1, 1, 2, 2, 3, 3, 4, 4]), (3, [1.25, 2.5, 3.75])])
def test_parts_are_averaged_repeated_or_cut(slots: int, wanted: list[float]) -> None:
    np.testing.assert_allclose(resample(np.array([1.0, 2.0, 3.0, 4.0]), slots), wanted)
