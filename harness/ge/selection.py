"""Who passes on unchanged, and who become parents: by fitness, by cases, or by behaviour.

All are pure functions of a pool of individuals that may breed together; randomness is an argument.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from harness.ge.operators import tournament
from harness.ge.parameters import LEXICASE, MAP_ELITES, NOVELTY, TOURNAMENT, Parameters
from harness.model.tables import compiled

Indices = NDArray[np.intp]

DESCRIPTORS = 3
"""Numbers D of a behaviour."""
NEIGHBOURS = 15
"""Nearest behaviours whose mean distance is the novelty (Lehman and Stanley 2011)."""
REMEMBERED = 6
"""Individuals of a generation whose behaviour the archive of novelty search keeps, drawn at random."""


class Pool(NamedTuple):
    """Individuals that may breed together; row i of every array is of individual i."""

    fitness: NDArray[np.float64]
    """(n,) higher is better, −inf for invalid ones."""
    cases: NDArray[np.float64] | None = None
    """(n, E) fitness in each of the generation's episodes."""
    descriptors: NDArray[np.float64] | None = None
    """(n, D) behaviour, every number from 0 to 1."""
    seen: NDArray[np.float64] = np.zeros((0, DESCRIPTORS))
    """(kept, D) behaviours that earlier generations have shown."""

    def only(self, members: Indices) -> Pool:
        """Some of the individuals."""
        cases, descriptors = (None if each is None else each[members] for each in (self.cases, self.descriptors))
        return Pool(self.fitness[members], cases, descriptors, self.seen)


def survivors(pool: Pool, p: Parameters, room: int) -> Indices:
    """Who pass on unchanged to where there is ``room``: with ``map-elites`` the archive, else the ``p.elites`` best."""
    if p.selection == MAP_ELITES:
        return archive(pool, room // 2)
    return np.argsort(-pool.fitness, kind="stable")[: p.elites]


def parents(pool: Pool, kept: Indices, p: Parameters, count: int, rng: np.random.Generator) -> Indices:
    """Parents of ``count`` children; ``kept`` are the survivors."""
    return _METHODS[p.selection](pool, kept, p, count, rng)


def distinct(pool: Pool) -> Indices:
    """The first of all individuals that earn the same in every episode (on average, where that is exact)."""
    rows = pool.fitness if pool.cases is None else pool.cases
    first: dict[bytes, int] = {}
    for i, row in enumerate(rows):
        first.setdefault(row.tobytes(), i)
    return np.array(list(first.values()), dtype=np.intp)


def lexicase(cases: NDArray[np.float64], orders: NDArray[np.intp], lots: NDArray[np.float64]) -> Indices:
    """Winners of ε-lexicase selection (La Cava, Spector and Danai 2016; La Cava et al. 2019, semi-dynamic).

    For each winner the cases are gone through in an order of its own. A case leaves those in the running that are
    within ε of the best of them, where ε is the median absolute deviation of all individuals in this case.

    Args:
        cases: (n, E) finite, higher is better.
        orders: (winners, ·) the cases that decide on each, in this order.
        lots: (winners,) in [0, 1), which chooses among those that are left.
    """
    deviation = np.abs(cases - np.median(cases, axis=0))
    winners = np.empty(len(orders), dtype=np.intp)
    _filter(np.ascontiguousarray(cases.T), np.median(deviation, axis=0), orders, lots, winners)
    return winners


@compiled
def _filter(
    cases: NDArray[np.float64],
    epsilon: NDArray[np.float64],
    orders: NDArray[np.intp],
    lots: NDArray[np.float64],
    winners: NDArray[np.intp],
) -> None:
    running = np.empty(cases.shape[1], dtype=np.int64)
    for k in range(len(orders)):
        left = cases.shape[1]
        for i in range(left):
            running[i] = i
        for c in orders[k]:
            best = -np.inf
            for i in range(left):
                best = max(best, cases[c, running[i]])
            passed = 0
            for i in range(left):
                if cases[c, running[i]] >= best - epsilon[c]:
                    running[passed] = running[i]
                    passed += 1
            left = passed
            if left == 1:
                break
        winners[k] = running[int(lots[k] * left)]


def novelty(descriptors: NDArray[np.float64], seen: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) mean distance of each behaviour to its nearest among the others and those seen before (Lehman and Stanley
    2011)."""
    known = np.concatenate([descriptors, seen])
    nearest = min(NEIGHBOURS, len(known) - 1)
    if nearest == 0:
        return np.zeros(len(descriptors))
    distances = KDTree(known).query(descriptors, nearest + 1)[0]
    return distances.sum(axis=1) / nearest  # the nearest of all is itself, or its like, at distance 0


def remembered(pool: Pool, rng: np.random.Generator) -> NDArray[np.float64]:
    """The archive of novelty search, with a few behaviours more."""
    assert pool.descriptors is not None
    valid = pool.descriptors[np.isfinite(pool.fitness)]
    new = valid[rng.permutation(len(valid))[:REMEMBERED]]
    return np.concatenate([pool.seen, new])


def archive(pool: Pool, most: int) -> Indices:
    """The fittest individual of each cell of a grid over behaviour (MAP-Elites, Mouret and Clune 2015).

    The grid is as fine as leaves ``most`` cells with anybody in them. The archive is a part of the population, so its
    elites are evaluated anew in every generation, and none stays for having been lucky.
    """
    assert pool.descriptors is not None
    order = np.argsort(-pool.fitness, kind="stable")
    order = order[np.isfinite(pool.fitness[order])]
    found = order[:1]
    for parts in range(1, _FINEST + 1):
        cells = np.minimum(pool.descriptors[order] * parts, parts - 1).astype(np.int64).tolist()
        fittest: dict[tuple[int, ...], int] = {}
        for i, cell in zip(order, cells, strict=True):
            fittest.setdefault(tuple(cell), i)
        if len(fittest) > most:
            break
        found = np.array(list(fittest.values()), dtype=np.intp)
    return found


_FINEST = 50  # parts of a descriptor's range


def _by_tournament(pool: Pool, kept: Indices, p: Parameters, count: int, rng: np.random.Generator) -> Indices:
    return tournament(pool.fitness, p.tournament, count, rng)


def _by_lexicase(pool: Pool, kept: Indices, p: Parameters, count: int, rng: np.random.Generator) -> Indices:
    assert pool.cases is not None
    valid = np.flatnonzero(np.isfinite(pool.fitness))
    if not len(valid):
        return rng.integers(0, len(pool.fitness), count)
    episodes = pool.cases.shape[1]
    sample = rng.permutation(episodes)[: max(1, round(p.cases * episodes))]
    orders = rng.permuted(np.tile(sample, (count, 1)), axis=1)
    return valid[lexicase(pool.cases[valid], orders, rng.random(count))]


def _by_novelty(pool: Pool, kept: Indices, p: Parameters, count: int, rng: np.random.Generator) -> Indices:
    assert pool.descriptors is not None
    valid = np.isfinite(pool.fitness)
    scores = np.full(len(valid), -np.inf)
    scores[valid] = novelty(pool.descriptors[valid], pool.seen)
    return tournament(scores, p.tournament, count, rng)


def _of_archive(pool: Pool, kept: Indices, p: Parameters, count: int, rng: np.random.Generator) -> Indices:
    among = kept if len(kept) else np.arange(len(pool.fitness))
    return among[rng.integers(0, len(among), count)]


_METHODS: dict[str, Callable[[Pool, Indices, Parameters, int, np.random.Generator], Indices]] = {
    TOURNAMENT: _by_tournament,
    LEXICASE: _by_lexicase,
    NOVELTY: _by_novelty,
    MAP_ELITES: _of_archive,
}
