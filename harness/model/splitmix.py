"""Random numbers inside compiled loops: SplitMix64, seeded by one 64-bit number that Philox drew."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness.model.tables import inlined


@inlined
def next_uniform(state: NDArray[np.uint64]) -> float:
    """SplitMix64 (Steele, Lea and Flood 2014): a uniform number in [0, 1) from a one-element state."""
    state[0] += np.uint64(0x9E3779B97F4A7C15)
    z = state[0]
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.float64((z ^ (z >> np.uint64(31))) >> np.uint64(11)) * 2.0**-53


@inlined
def uniform_at(seed: np.uint64, n: int) -> float:
    """The n-th number (from 0) that :func:`next_uniform` gives from a state of ``seed``, without those before it."""
    z = seed + np.uint64(0x9E3779B97F4A7C15) * np.uint64(n + 1)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.float64((z ^ (z >> np.uint64(31))) >> np.uint64(11)) * 2.0**-53
