"""Random numbers depend on what they are for, and on nothing else."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from zengrid.scenario.randomness import bell, fork, keys_of, uniform

KEYS = ["0x39f31389e7f52099", "0xf0aa1b369fa47144"]
BELLS = [0.8508287299814585, -0.19760961743457786]
NAMES = st.lists(st.text("abcdefghij0123456789-_", min_size=1, max_size=63), min_size=1, max_size=20, unique=True)


@given(NAMES, st.integers(0, 2**63 - 1), st.data())
def test_a_name_has_its_key_in_any_company(names: list[str], seed: int, data: st.DataObject) -> None:
    together = keys_of(names, seed)
    place = data.draw(st.integers(0, len(names) - 1))
    assert keys_of([names[place]], seed)[0] == together[place]
    assert len(set(together.tolist())) == len(names)


@given(st.integers(0, 2**63 - 1), st.integers(0, 2**40))
def test_a_branch_is_the_same_alone_and_in_a_table(seed: int, day: int) -> None:
    keys = keys_of(["a", "b", "c"], seed)
    table = fork(keys[:, None], np.arange(day, day + 5))
    for row in range(3):
        for column in range(5):
            assert fork(keys[row : row + 1], day + column)[0] == table[row, column]


def test_numbers_spread_as_they_should() -> None:
    keys = fork(keys_of(["x"], 7), np.arange(200_000))
    even, bells = uniform(keys), bell(keys)
    assert 0.0 <= even.min() < 1e-4
    assert 1 - 1e-4 < even.max() < 1.0
    assert abs(even.mean() - 0.5) < 0.003
    assert abs(bells.mean()) < 0.01
    assert abs(bells.std() - 1.0) < 0.01
    assert np.abs(bells).max() <= 3.47
    assert abs(np.corrcoef(bells[1:], bells[:-1])[0, 1]) < 0.01


def test_the_numbers_never_change() -> None:
    """Runs are repeated from their seed: a change here changes every result ever published."""
    keys = keys_of(["p1", "p2"], 0)
    assert [hex(key) for key in keys.tolist()] == KEYS
    assert bell(fork(keys, 1)).tolist() == BELLS
