"""Which levels the product grid should have next: those that the beliefs met by its own greedy policy call for."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from harness.solver import levels as level_sets
from harness.solver.branches import Branches
from harness.solver.grid import Above
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


def with_priors(b: Branches, above: Above, g: Graph, most: int) -> list[list[Point]]:
    """Corners, and the initial belief of as many factors as ``most`` cells allow, the most worth knowing first."""
    sizes = np.diff(b.factor_offset).tolist()
    points = level_sets.corners(sizes)
    spans = np.empty(len(sizes))
    sensitivity(b, above, int(g.visible[0]), g.belief[0], spans)
    for k in np.argsort(-spans, kind="stable"):
        start = tuple(float(p) for p in g.belief[0, b.factor_offset[k] : b.factor_offset[k + 1]])
        wider = [*points[k], start]
        if level_sets.make([*points[:k], wider, *points[k + 1 :]]).cells <= most:
            points[k] = wider
    return points


def refined(g: Graph, m: Model, levels: Levels, most: int, seed: int) -> list[list[Point]]:
    """The levels with others beside them, as many as ``most`` cells allow, each where it saves most.

    What a level saves is judged by the beliefs of greedy runs: between the levels l and r, a convex function may lie
    below its chord at b by as much as (b − l)(r − b)/(r − l) of its change of slope, here taken to be what it is worth
    to know the factor's value. For factors of more than two values the part of a belief that no inner level carries
    takes that place.
    """
    b = m.branches
    sizes = np.diff(b.factor_offset).tolist()
    points = points_of(levels, sizes)
    met = [_distinct(*each) for each in _met(g, m, seed)]
    while True:
        best, choice = 0.0, None
        for k, n in enumerate(sizes):
            cells = int(np.prod([len(p) + (i == k) for i, p in enumerate(points)]))
            if cells <= most:
                saved, point = _best_level(points[k], *met[k], n)
                if saved / (1 + 1 / len(points[k])) > best:
                    best, choice = saved / (1 + 1 / len(points[k])), (k, point)
        if choice is None:
            return points
        points[choice[0]] = [*points[choice[0]], choice[1]]


def _met(g: Graph, m: Model, seed: int) -> Iterator[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """For each factor its beliefs in greedy runs, and what they count: the discount by then times the factor's worth."""
    offset = m.branches.factor_offset
    beliefs, weights = np.empty((_RUNS * _HORIZON, offset[-1])), np.empty((_RUNS * _HORIZON, len(offset) - 1))
    count = greedy_runs(m, int(g.visible[0]), g.belief[0], seed, _RUNS, _HORIZON, beliefs, weights)
    for k, weight in enumerate(weights[:count].T):
        yield beliefs[:count, offset[k] : offset[k + 1]], weight


def _distinct(
    beliefs: NDArray[np.float64], weight: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The beliefs that differ, and what they count together."""
    apart, index = np.unique(np.round(beliefs, 6), axis=0, return_inverse=True)
    return apart, np.bincount(index.ravel(), weight, len(apart))


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
