"""Random numbers inside compiled loops: SplitMix64, seeded by one 64-bit number that Philox drew."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness.model.tables import inlined

STRIDE = np.uint64(0x9E3779B97F4A7C15)
"""From one state to the next: a number that nobody looks at costs an addition."""


@inlined
def uniform_of(state: np.uint64) -> float:
    """The uniform number in [0, 1) of a state (Steele, Lea and Flood 2014)."""
    z = state
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.float64((z ^ (z >> np.uint64(31))) >> np.uint64(11)) * 2.0**-53


@inlined
def next_uniform(state: NDArray[np.uint64]) -> float:
    """A uniform number in [0, 1) from a one-element state, which moves on."""
    state[0] += STRIDE
    return uniform_of(state[0])


@inlined
def uniform_at(seed: np.uint64, n: int) -> float:
    """The n-th number (from 0) that :func:`next_uniform` gives from a state of ``seed``, without those before it."""
    return uniform_of(seed + STRIDE * np.uint64(n + 1))
