"""Situations: all that a policy knows and remembers at a step, each with its probability; those that begin an episode.

A layer of S situations is two arrays: ``mass`` (S,), their probabilities, and ``key`` (S, M + 1 + N) of 64-bit words,
in which equal situations have equal rows: M words of the policy's memory, one of what it sees (visible value and
reading), and the N marginals of the exact belief as the bits of their floating-point numbers.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.engine.tables import start_beliefs
from harness.model.domain import Domain

SEEN = 1 << 32
"""The word of what is seen is visible value · SEEN + reading + 1."""


class Layer(NamedTuple):
    """The situations of one step."""

    key: NDArray[np.int64]
    mass: NDArray[np.float64]


def visible_of(seen: NDArray[np.int64]) -> NDArray[np.int32]:
    """Visible values from words of what is seen."""
    return (seen // SEEN).astype(np.int32)


def reading_of(seen: NDArray[np.int64]) -> NDArray[np.int32]:
    """Readings, −1 for none, from words of what is seen."""
    return (seen % SEEN - 1).astype(np.int32)


def first_layer(domain: Domain) -> Layer:
    """The situations before the first step, of a policy that remembers nothing yet (M = 0)."""
    t = domain.tables
    readings = domain.n_observations + 1  # the first of them: none
    chance = np.diff(t.start_cdf, prepend=0.0)
    together = np.zeros(domain.n_visible * readings)
    for row in np.unique(t.start_reading):
        here = t.start_reading == row
        of_reading = np.eye(readings)[0] if row < 0 else np.append(0.0, t.reading_probability[row])
        for o in np.flatnonzero(of_reading):
            np.add.at(together, t.start_visible[here].astype(np.int64) * readings + o, chance[here] * of_reading[o])
    found = np.flatnonzero(together)
    visible, reading = (found // readings).astype(np.int32), (found % readings - 1).astype(np.int32)
    marginals = np.zeros((len(found), domain.n_marginals))
    every = np.ones(len(visible), dtype=np.bool_)
    start_beliefs(t, every, visible, reading, marginals, np.zeros(max(domain.factor_sizes, default=1)))
    key = np.empty((len(found), 1 + domain.n_marginals), dtype=np.int64)
    key[:, 0] = visible.astype(np.int64) * SEEN + reading + 1
    key[:, 1:] = marginals.view(np.int64)
    return Layer(key, together[found])
