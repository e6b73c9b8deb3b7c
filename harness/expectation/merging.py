"""Equal situations become one, and so do those that differ in what their policy will never look at."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness.model.tables import compiled, inlined

GRAIN = 2.0**46
"""Marginals that the policy will not look at are rounded to whole numbers of 1/GRAIN, so that what is equal but for
rounding becomes equal; those that it may look at keep every bit."""


@compiled
def merge(
    key: NDArray[np.int64],
    mass: NDArray[np.float64],
    watched: NDArray[np.bool_],
    factor_offset: NDArray[np.int64],
) -> tuple[int, int]:
    """Merge a layer in place; its situations are then the first rows. Returned: how many, and most merged into one.

    ``watched`` (S, K): factors whose belief the policy may yet look at; where ``key`` rows have equal memory they must
    be equal too.

    Situations with equal rows are one. Those that differ in the belief over one factor only, which the policy will not
    look at, are one too, with the mean of both beliefs: factors are independent, so that
    m₁ · b₁ ⊗ rest + m₂ · b₂ ⊗ rest = (m₁ + m₂) · mean ⊗ rest, and the policy does the same after both.
    """
    n, most = len(key), 1
    plain = True
    for k in range(watched.shape[1]):
        if not watched[:n, k].all():
            _round(key, n, watched, factor_offset, k)
    for k in range(watched.shape[1]):
        if not watched[:n, k].all():
            n, merged = _merge(key, mass, watched, factor_offset, n, k)
            most, plain = max(most, merged), False
    if plain:
        n, most = _merge(key, mass, watched, factor_offset, n, -1)
    return n, most


@compiled
def _round(
    key: NDArray[np.int64], n: int, watched: NDArray[np.bool_], factor_offset: NDArray[np.int64], k: int
) -> None:
    marginals = key.view(np.float64)
    first, last = _columns(key, factor_offset, k)
    for e in range(n):
        if not watched[e, k]:
            _settle(marginals, e, first, last, 1.0)


@compiled
def _merge(
    key: NDArray[np.int64],
    mass: NDArray[np.float64],
    watched: NDArray[np.bool_],
    factor_offset: NDArray[np.int64],
    n: int,
    k: int,
) -> tuple[int, int]:
    """One pass: what factor ``k`` (−1: none) is believed to be does not count where it is not watched."""
    marginals = key.view(np.float64)
    first, last = _columns(key, factor_offset, k)
    size = 16
    while size < 2 * n:
        size *= 2
    table = np.full(size, -1, dtype=np.int32)
    members = np.zeros(n, dtype=np.int32)
    count = 0
    for e in range(n):
        blind = k >= 0 and not watched[e, k]
        low, high = (first, last) if blind else (0, 0)  # columns that do not count
        slot = hashed(key, e, low, high) & (size - 1)
        while table[slot] >= 0 and not equal(key, table[slot], e, low, high):
            slot = (slot + 1) & (size - 1)
        r = table[slot]
        if r < 0:
            r = table[slot] = count
            count += 1
            _move(key, mass, watched, e, r)
            for c in range(low, high):
                marginals[r, c] *= mass[r]
        else:
            for c in range(low, high):
                marginals[r, c] += mass[e] * marginals[e, c]
            mass[r] += mass[e]
        members[r] += 1
    for r in range(count):
        if k >= 0 and not watched[r, k]:
            _settle(marginals, r, first, last, mass[r])
    return count, int(members.max()) if count else 1


@inlined
def _move(key: NDArray[np.int64], mass: NDArray[np.float64], watched: NDArray[np.bool_], e: int, r: int) -> None:
    if r != e:
        for c in range(key.shape[1]):
            key[r, c] = key[e, c]
        for k in range(watched.shape[1]):
            watched[r, k] = watched[e, k]
        mass[r] = mass[e]


@inlined
def _columns(key: NDArray[np.int64], factor_offset: NDArray[np.int64], k: int) -> tuple[int, int]:
    words = key.shape[1] - factor_offset[-1]
    return (words + factor_offset[k], words + factor_offset[k + 1]) if k >= 0 else (0, 0)


@inlined
def _settle(marginals: NDArray[np.float64], e: int, first: int, last: int, total: float) -> None:
    """Divide by the total and round to the grain; of two values the first is what the second leaves."""
    for c in range(first, last):
        marginals[e, c] = np.rint(marginals[e, c] / total * GRAIN) / GRAIN
    if last - first == 2:
        marginals[e, first] = 1.0 - marginals[e, first + 1]


@inlined
def hashed(key: NDArray[np.int64], e: int, low: int, high: int) -> np.int64:
    """Of a row, without the columns ``low … high − 1``."""
    h = np.uint64(0x9E3779B97F4A7C15)
    for c in range(key.shape[1]):
        if c < low or c >= high:
            h = (h ^ np.uint64(key[e, c])) * np.uint64(0xBF58476D1CE4E5B9)
            h ^= h >> np.uint64(29)
    return np.int64(h >> np.uint64(2))


@inlined
def equal(key: NDArray[np.int64], r: int, e: int, low: int, high: int) -> bool:
    """Whether two rows are equal but for these columns."""
    same = True
    for c in range(key.shape[1]):
        if (c < low or c >= high) and key[r, c] != key[e, c]:
            same = False
    return same
