"""Random numbers by key: they do not depend on the order or the batch in which they are drawn.

Every number is a hash of (seed, purpose, name, day, slot). Only integer arithmetic and single float64 operations are
used, because numpy's transcendental functions may round differently at different positions of an array.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
RandomKeys = NDArray[np.uint64]

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_NAME_BYTES = 64
_BELL_SCALE = 3.0**0.5 / 65536.0


def mix(bits: RandomKeys) -> RandomKeys:
    """Apply the finaliser of SplitMix64: every bit of the result depends on every input bit.

    Source: Steele, Lea, Flood, "Fast splittable pseudorandom number generators", doi:10.1145/2714064.2660195.
    """
    bits = bits ^ (bits >> np.uint64(30))
    bits *= np.uint64(0xBF58476D1CE4E5B9)
    bits ^= bits >> np.uint64(27)
    bits *= np.uint64(0x94D049BB133111EB)
    bits ^= bits >> np.uint64(31)
    return bits


def keys_of(names: Sequence[str], seeds: Sequence[int] | int = 0) -> RandomKeys:
    """Return a key for each name and seed, ``(name,)``; only the first 64 bytes of a name count."""
    text = np.array([name.encode()[:_NAME_BYTES] for name in names], dtype=f"S{_NAME_BYTES}")
    words = text.view(np.uint8).reshape(len(names), _NAME_BYTES).view("<u8").astype(np.uint64)
    key = mix(np.broadcast_to(np.asarray(seeds, dtype=np.uint64), (len(names),)).copy())
    for column in range(words.shape[1]):
        key = mix((key + _GOLDEN) ^ words[:, column])
    return key


def fork(keys: RandomKeys, number: NDArray[np.integer] | int) -> RandomKeys:
    """Derive keys for numbered branches of other keys; both arguments broadcast."""
    return mix(keys + _GOLDEN * (np.atleast_1d(number).astype(np.uint64) + np.uint64(1)))


def uniform(keys: RandomKeys) -> Floats:
    """Uniform numbers in [0, 1), one for each key."""
    return (keys >> np.uint64(11)).astype(np.float64) * 2.0**-53


def bell(keys: RandomKeys) -> Floats:
    """Bell-shaped numbers of mean 0, standard deviation 1, within +-3.47: sums of four uniform numbers of 16 bits."""
    pairs = (keys & np.uint64(0x0000FFFF0000FFFF)) + ((keys >> np.uint64(16)) & np.uint64(0x0000FFFF0000FFFF))
    total = (pairs & np.uint64(0xFFFFFFFF)) + (pairs >> np.uint64(32))
    return (total.astype(np.float64) - 131070.0) * _BELL_SCALE
