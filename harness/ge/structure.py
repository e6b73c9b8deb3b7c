"""The structure of a population: islands and age layers, as groups of one population.

A group is a range of the population's places. So a run has one population and one checkpoint however it is structured.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness.ge.parameters import Parameters
from harness.ge.selection import Indices


def groups(p: Parameters) -> list[Indices]:
    """The places of each island or layer, the youngest layer first; of an unstructured population, all."""
    return np.array_split(np.arange(p.population), max(p.islands, p.layers))


def pools(p: Parameters, fitness: NDArray[np.float64], born: NDArray[np.int32], number: int) -> list[Indices]:
    """Those whose children take each group's places in generation ``number``; where there is nobody, it begins anew.

    Args:
        p: the structure.
        fitness: (n,) of the generation before.
        born: (n,) generation of the oldest ancestor of each.
        number: the new generation's.
    """
    begins = number % p.epoch == 0
    if p.layers > 1:
        return _layers(p, number - born, begins)
    found = groups(p)
    return _migrated(found, fitness) if p.islands > 1 and begins else found


def _migrated(islands: list[Indices], fitness: NDArray[np.float64]) -> list[Indices]:
    """On every island the best of the one before, round a ring, takes the place of its worst (Whitley, Rana and
    Heckendorn 1999)."""
    best = [island[fitness[island].argmax()] for island in islands]
    worst = [int(fitness[island].argmin()) for island in islands]
    arrived = [island.copy() for island in islands]
    for k, island in enumerate(arrived):
        island[worst[k]] = best[k - 1]
    return arrived


def _layers(p: Parameters, age: NDArray[np.int32], begins: bool) -> list[Indices]:
    """A layer and the one below, without those that are too old for it: they may enter the next one (ALPS, Hornby
    2006). The oldest layer has no limit, and the youngest begins anew at every epoch."""
    found = groups(p)
    both = [np.concatenate(found[max(0, k - 1) : k + 1]) for k in range(len(found))]
    limits = [p.epoch * max(k * k, k + 1) for k in range(len(found) - 1)]  # 1, 2, 4, 9, 16, … epochs
    young = [pool[age[pool] <= limit] for pool, limit in zip(both, limits, strict=False)]
    return [young[0][:0] if begins else young[0], *young[1:], both[-1]]
