"""A policy graph: the lower bound's policy as nodes, each with an action and where every branch leads."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.model.tables import compiled
from harness.solver import search
from harness.solver.anytime import Course
from harness.solver.lookahead import Model
from harness.solver.plans import LONGEST, follow
from harness.solver.search import N_NODES, Graph


def policy_arrays(course: Course) -> dict[str, NDArray[Any]]:
    """The lower bound's policy from the start.

    Nodes are numbered from 0, the root. ``action`` (nodes,) is what a node does; its children are the entries
    ``first … first of the next − 1`` of ``edge_visible``, ``edge_reading`` (the next visible value and reading, −1:
    none) and ``edge_node``. Where there is no child, the policy goes on by the visible value alone: ``fallback`` (V,).
    Blind plans (:mod:`harness.solver.plans`) are nodes too, shared where they go on alike.
    """
    model, order = course.model, search.kept(course.graph, course.branches)[0]
    action, first, visible, reading, node = _nodes(course.graph, model, order, *_targets(course.graph, model, order))
    return {
        "action": action,
        "first": first.astype(np.int32),
        "edge_visible": visible,
        "edge_reading": reading,
        "edge_node": node,
        "fallback": course.floor_action.astype(np.int16),
    }


class _Steps(NamedTuple):
    """The steps of plans, those at the end of a plan before those that lead there. S steps."""

    visible: NDArray[np.int64]
    action: NDArray[np.int64]
    follows: NDArray[np.int64]
    """(S,) the next step; −1: the fallback"""


@compiled
def _targets(g: Graph, m: Model, order: NDArray[np.int64]) -> tuple[NDArray[np.int64], _Steps]:
    """(M,) the policy's node for each node of the search, −1 for the fallback; and the steps of the plans at leaves.

    Nodes with an action come first, in ``order``; then the steps, the last one first.
    """
    target, count = np.full(g.counts[N_NODES], -1, dtype=np.int64), 0
    for i in order:
        if g.action[i] >= 0:
            target[i] = count
            count += 1
    path, known = np.empty((LONGEST, 2), dtype=np.int32), {(np.int64(0), np.int64(0), np.int64(-1)): -1}
    visible, action, follows = [np.int64(0) for _ in range(0)], [np.int64(0) for _ in range(0)], [-1 for _ in range(0)]
    head = np.full(len(target), -1, dtype=np.int64)
    for i in order:
        if g.action[i] < 0:
            for t in range(follow(m.branches, m.plans, m.floor, g.visible[i], g.belief[i], path)[1] - 1, -1, -1):
                step = np.int64(path[t, 0]), np.int64(path[t, 1]), head[i]
                if known.get(step, -1) < 0:
                    known[step] = len(visible)
                    visible.append(step[0])
                    action.append(step[1])
                    follows.append(step[2])
                head[i] = known[step]
    for i in order:
        if head[i] >= 0:
            target[i] = count + len(visible) - 1 - head[i]
    return target, _Steps(np.array(visible, dtype=np.int64), np.array(action), np.array(follows))


@compiled
def _nodes(
    g: Graph, m: Model, order: NDArray[np.int64], target: NDArray[np.int64], steps: _Steps
) -> tuple[NDArray[np.int16], NDArray[np.int64], NDArray[np.int32], NDArray[np.int32], NDArray[np.int32]]:
    b = m.branches
    action = [np.int16(0) for _ in range(0)]
    first = [np.int64(0)]
    visible = [np.int32(0) for _ in range(0)]
    reading = [np.int32(0) for _ in range(0)]
    node = [np.int32(0) for _ in range(0)]
    for i in order:
        if g.action[i] >= 0:
            va, edge = g.visible[i] * b.n_actions + g.action[i], g.first_edge[i, g.action[i]]
            for j in range(b.first_branch[va], b.first_branch[va + 1]):
                c = g.child[edge + j - b.first_branch[va]]
                if c >= 0 and target[c] >= 0:
                    visible.append(b.branch[j].visible)
                    reading.append(b.branch[j].reading)
                    node.append(np.int32(target[c]))
            action.append(np.int16(g.action[i]))
            first.append(np.int64(len(visible)))
    decided, count = len(action), len(steps.visible)
    for s in range(count - 1, -1, -1):
        va = steps.visible[s] * b.n_actions + steps.action[s]
        for j in range(b.first_branch[va], b.first_branch[va + 1]):
            if steps.follows[s] >= 0 and not b.branch[j].ends:
                visible.append(b.branch[j].visible)
                reading.append(b.branch[j].reading)
                node.append(np.int32(decided + count - 1 - steps.follows[s]))
        action.append(np.int16(steps.action[s]))
        first.append(np.int64(len(visible)))
    if len(action) == 0:  # the start itself is left to the fallback
        action.append(np.int16(-1))
        first.append(np.int64(0))
    return np.array(action), np.array(first), np.array(visible), np.array(reading), np.array(node)
