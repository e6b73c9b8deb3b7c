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

TRAINING = 1 << 62
"""Added to the seed of episodes that a search (evolution, tuning) selects by: far from the seeds people score with."""
HELD_OUT = 1 << 61
"""Added to the seed of fresh episodes, which score what a search found and which it never saw."""

_BLOCK = 4  # Philox makes four 64-bit numbers for each value of its counter


def uniforms(seed: int, stream: int, step: int, first: int, count: int) -> NDArray[np.float64]:
    """Numbers in [0, 1) for episodes ``first … first + count − 1``, an array of shape ``(count,)``.

    ``step`` is 0 for the reset and t for the t-th step.
    """
    bits = np.random.Philox(key=[seed, (stream << 32) | step])
    bits.advance(first // _BLOCK)
    skip = first % _BLOCK
    return np.random.Generator(bits).random(skip + count)[skip:]


def generator(seed: int, stream: int, step: int) -> np.random.Generator:
    """A generator for whatever a step needs; it depends on nothing that was drawn before."""
    return np.random.Generator(np.random.Philox(key=[seed, (stream << 32) | step]))
