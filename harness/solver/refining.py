"""Which levels the product grid should have next: those that the beliefs met by its own greedy policy call for."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from harness.solver.levels import Levels, Point
from harness.solver.lookahead import Model, greedy_runs, sensitivity
from harness.solver.search import Graph

_RUNS = 200
_HORIZON = 100


def points_of(levels: Levels, sizes: list[int]) -> list[list[Point]]:
    """The beliefs of every factor's levels."""
    edges = levels.offset
    return [
        [tuple(float(p) for p in row[:n]) for row in levels.point[edges[k] : edges[k + 1]]] for k, n in enumerate(sizes)
    ]


def with_priors(m: Model, g: Graph, levels: Levels, most: int) -> list[list[Point]]:
    """The levels, and the initial belief of as many factors as ``most`` cells allow, the most worth knowing first."""
    b = m.branches
    sizes = np.diff(b.factor_offset).tolist()
    points, spans = points_of(levels, sizes), np.empty(len(sizes))
    sensitivity(b, m.above, int(g.visible[0]), g.belief[0], spans)
    for k in np.argsort(-spans, kind="stable"):
        start = tuple(float(p) for p in g.belief[0, b.factor_offset[k] : b.factor_offset[k + 1]])
        if start not in points[k] and _cells(points, k) <= most:
            points[k] = [*points[k], start]
    return points


def _cells(points: list[list[Point]], k: int) -> int:
    """Cells of the grid with one more level of factor ``k``."""
    return math.prod(len(p) + (i == k) for i, p in enumerate(points))


def refined(m: Model, g: Graph, levels: Levels, inner: int) -> list[list[Point]]:
    """The levels with others beside them, ``inner`` a factor at most beside the certain ones, each where it saves most.

    What a level saves is judged by the beliefs of greedy runs: between the levels l and r, a convex function may lie
    below its chord at b by as much as (b − l)(r − b)/(r − l) of its change of slope, here taken to be what it is worth
    to know the factor's value. For factors of more than two values the part of a belief that no inner level carries
    takes that place.
    """
    sizes = np.diff(m.branches.factor_offset).tolist()
    points = points_of(levels, sizes)
    met = [_distinct(*each) for each in _met(g, m, inner)]
    for k, n in enumerate(sizes):
        while len(points[k]) < n + inner and _cells(points, k) < 2**62:
            saved, point = _best_level(points[k], *met[k], n)
            if saved <= 0.0:
                break
            points[k] = [*points[k], point]
    return points


def _met(g: Graph, m: Model, seed: int) -> Iterator[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """For each factor its beliefs in greedy runs, and what they count: the discount times the factor's worth."""
    offset = m.branches.factor_offset
    beliefs, weights = np.empty((_RUNS * _HORIZON, offset[-1])), np.empty((_RUNS * _HORIZON, len(offset) - 1))
    count = greedy_runs(m, int(g.visible[0]), g.belief[0], seed, _RUNS, _HORIZON, beliefs, weights)
    for k, weight in enumerate(weights[:count].T):
        yield beliefs[:count, offset[k] : offset[k + 1]], weight


def _distinct(
    beliefs: NDArray[np.float64], weight: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The beliefs that differ, and what they count together; as they were met, so that a level is met exactly."""
    apart, first, index = np.unique(np.round(beliefs, 6), axis=0, return_index=True, return_inverse=True)
    return beliefs[first], np.bincount(index.ravel(), weight, len(apart)).astype(np.float64)


def _best_level(
    points: list[Point], candidates: NDArray[np.float64], total: NDArray[np.float64], n: int
) -> tuple[float, Point]:
    """What the best new level would save, and that level: one of the beliefs met."""
    loss = _losses(points, candidates, n)
    now = float(total @ loss)
    best, found = 0.0, tuple(candidates[0])
    for i in np.argsort(-(total * loss), kind="stable")[:40]:
        if loss[i] > 1e-6:
            saved = now - float(total @ np.minimum(loss, _losses([*points, tuple(candidates[i])], candidates, n)))
            if saved > best:
                best, found = saved, tuple(candidates[i])
    return best, found


def _losses(points: list[Point], beliefs: NDArray[np.float64], n: int) -> NDArray[np.float64]:
    if n == 2:
        levels = np.sort([p[1] for p in points])
        b = beliefs[:, 1]
        right = np.clip(np.searchsorted(levels, b, side="right"), 1, len(levels) - 1)
        low, high = levels[right - 1], levels[right]
        return (b - low) * (high - b) / (high - low)
    carried = np.zeros(len(beliefs))
    for p in points:
        inner = np.array(p)
        if (inner > 0).sum() > 1:
            ratio = np.where(inner > 0, beliefs / np.where(inner > 0, inner, 1.0), np.inf).min(axis=1)
            carried = np.maximum(carried, ratio)
    return np.where(beliefs.max(axis=1) >= 1.0, 0.0, 1.0 - carried)
