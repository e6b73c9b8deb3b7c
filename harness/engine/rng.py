"""Uniform random numbers that belong to (seed, stream, step, episode), whatever the batch.

NumPy's Philox is counter-based: its key holds the seed, the stream and the step, its counter is advanced to the
episode. Episode k of seed s therefore sees the same numbers in any batch, order and number of workers.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

ENGINE, POLICY, VARIATION = 0, 1, 1 << 20
"""Streams: the engine's (next states, observations), the policies' own, which no policy choice can mix (POLICY and
up), and the variation of an evolutionary search."""


TUNER = 1 << 31
"""Stream of the tuning methods' own draws (perturbations, candidates)."""

LOCAL_SEARCH = VARIATION + 1
"""Stream of the edits that a local search tries in an evolutionary search."""

RESAMPLING = TUNER + 1
"""Stream of the draws behind bootstrap intervals."""

TRAINING = 1 << 62
"""Added to the seed of everything that learns, so that it never meets an episode that people score with."""

HELD_OUT = 1 << 61
"""Added to the seed of the fresh episodes on which what was learnt is scored."""

VALIDATION = 1 << 63
"""Added to the seed of the episodes that choose among what a tuning run has visited."""

REFINEMENT = TRAINING + HELD_OUT
"""Added to the seed of the episodes on which constants are tuned in the course of an evolution."""

_BLOCK = 4  # Philox makes four 64-bit numbers for each value of its counter


def uniforms(seed: int, stream: int, step: int, first: int, count: int) -> NDArray[np.float64]:
    """Numbers in [0, 1) for episodes ``first … first + count − 1``, an array of shape ``(count,)``.

    ``step`` is 0 for the reset and t for the t-th step.
    """
    bits = _philox(seed, stream, step)
    bits.advance(first // _BLOCK)
    skip = first % _BLOCK
    return np.random.Generator(bits).random(skip + count)[skip:]


def generator(seed: int, stream: int, step: int) -> np.random.Generator:
    """A generator for draws that belong to no episode; the same whenever it is made from the same numbers."""
    return np.random.Generator(_philox(seed, stream, step))


def _philox(seed: int, stream: int, step: int) -> np.random.Philox:
    key = np.array([seed, (stream << 32) | step], dtype=np.uint64)  # a plain list above 2**63 would be read as floats
    return np.random.Philox(key=key)
