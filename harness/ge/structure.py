"""The structure of a population: islands and age layers, as groups of one population.

A group is a range of the population's places. So a run has one population and one checkpoint however it is structured.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness.ge.parameters import Parameters

Indices = NDArray[np.intp]


def groups(p: Parameters) -> list[Indices]:
    """The places of each island or layer, the youngest layer first; of an unstructured population, all."""
    return np.array_split(np.arange(p.population), max(p.islands, p.layers))


def pools(p: Parameters, fitness: NDArray[np.float64], born: NDArray[np.int32], number: int) -> list[Indices]:
    """Those whose children take each group's places in generation ``number``.

    Args:
        p: the structure.
        fitness: (n,) of the generation before.
        born: (n,) generation of which an individual's oldest ancestor is.
        number: the new generation's.
    """
    if p.layers > 1:
        return _layers(p, number - born)
    found = groups(p)
    return _migrated(found, fitness) if p.islands > 1 and number % p.epoch == 0 else found


def renewed(p: Parameters, group: int, number: int) -> bool:
    """Whether a group of generation ``number`` is the youngest layer, and begins anew."""
    return p.layers > 1 and group == 0 and number % p.epoch == 0


def _migrated(islands: list[Indices], fitness: NDArray[np.float64]) -> list[Indices]:
    """On every island the best of the one before, round a ring, takes the place of its worst (Whitley, Rana and
    Heckendorn 1999)."""
    best = [island[fitness[island].argmax()] for island in islands]
    worst = [int(fitness[island].argmin()) for island in islands]
    arrived = [island.copy() for island in islands]
    for k, island in enumerate(arrived):
        island[worst[k]] = best[k - 1]
    return arrived


def _layers(p: Parameters, age: NDArray[np.int32]) -> list[Indices]:
    """A layer and the one below, without those that are too old for it (ALPS, Hornby 2006): they may enter the next."""
    found = groups(p)
    both = [np.concatenate(found[max(0, k - 1) : k + 1]) for k in range(len(found))]
    limits = [p.epoch * max(k * k, k + 1) for k in range(len(found))]  # 1, 2, 4, 9, 16, …
    return [pool[age[pool] <= limit] for pool, limit in zip(both[:-1], limits, strict=False)] + [both[-1]]
