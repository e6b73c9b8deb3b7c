"""Layers whose masses are dual numbers: what is never looked at is disclosed, equal situations added up, many thinned.

What a policy believes depends on what it did and read, never on its constants; so only the masses are dual. Means of
beliefs, by which :mod:`harness.expectation.merging` keeps situations few, would depend on the constants. Here a factor
that the policy will not look at any more takes each of its values instead, with the probability that it has.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness.expectation.merging import equal, hashed
from harness.model.tables import compiled


def disclose(
    key: NDArray[np.int64],
    mass: NDArray[np.float64],
    watched: NDArray[np.bool_],
    prior: NDArray[np.float64],
    factor_offset: NDArray[np.int64],
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.int64]]:
    """Situations (B', …) in which the values of factors that are not watched are known, their masses (B', 1 + d), and
    which of the situations (B, …) each comes from.

    ``watched``: (B, K). Where a belief is the first step's still, ``prior`` (N,), it stays: nothing is to be merged.
    """
    words, origin = key.shape[1] - len(prior), np.arange(len(key))
    for k in range(watched.shape[1]):
        columns = slice(words + factor_offset[k], words + factor_offset[k + 1])
        belief = np.ascontiguousarray(key[:, columns]).view(np.float64)
        known = watched[origin, k] | (belief == prior[factor_offset[k] : factor_offset[k + 1]]).all(axis=1)
        known |= (belief > 0).sum(axis=1) == 1
        if known.all():
            continue
        row, value = np.nonzero(belief * ~known[:, None])
        of = np.concatenate([np.flatnonzero(known), row])
        key, mass, origin = key[of], mass[of], origin[of]
        certain = np.eye(belief.shape[1])[value]
        key[len(of) - len(row) :, columns] = certain.view(np.int64)
        mass[len(of) - len(row) :] *= belief[row, value, None]
    return key, mass, origin


def together(key: NDArray[np.int64], mass: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """The different situations, each with the sum of its masses."""
    key, mass = np.ascontiguousarray(key), np.ascontiguousarray(mass)
    count = _together(key, mass)
    return key[:count], mass[:count]


@compiled
def _together(key: NDArray[np.int64], mass: NDArray[np.float64]) -> int:
    """In place: the first rows are then those."""
    size = 16
    while size < 2 * len(key):
        size *= 2
    table = np.full(size, -1, dtype=np.int32)
    count = 0
    for e in range(len(key)):
        slot = hashed(key, e, 0, 0) & (size - 1)
        while table[slot] >= 0 and not equal(key, table[slot], e, 0, 0):
            slot = (slot + 1) & (size - 1)
        r = table[slot]
        if r < 0:
            table[slot] = count
            if count != e:
                for c in range(key.shape[1]):
                    key[count, c] = key[e, c]
                for c in range(mass.shape[1]):
                    mass[count, c] = mass[e, c]
            count += 1
        else:
            for c in range(mass.shape[1]):
                mass[r, c] += mass[e, c]
    return count


def thin(
    key: NDArray[np.int64], mass: NDArray[np.float64], most: int, draw: float
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """At most ``most`` of the situations, without bias: those above a threshold as they are, of the others some, each
    as heavy as the threshold (Fearnhead and Clifford 2003, section 3.2). ``draw``: uniform in [0, 1).

    A situation of mass m is kept with probability m / threshold and then weighs as much, derivatives in proportion.
    """
    if len(mass) <= most:
        return key, mass
    order = np.argsort(-mass[:, 0], kind="stable")
    falling = mass[order, 0]
    rest = np.cumsum(falling[::-1])[::-1]  # of each and all that are lighter
    sure = int((falling[:most] * (most - np.arange(most)) <= rest[:most]).argmax())
    threshold = rest[sure] / (most - sure)
    at = np.searchsorted(np.cumsum(falling[sure:]), threshold * (draw + np.arange(most - sure)), side="right")
    drawn = order[sure + np.unique(np.minimum(at, len(order) - sure - 1))]
    kept = np.concatenate([order[:sure], drawn])
    key, mass = key[kept], mass[kept]
    mass[sure:] *= threshold / mass[sure:, :1]
    return key, mass
