"""A policy graph: the lower bound's policy as nodes, each with an action and where every branch leads."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.model.tables import compiled
from harness.solver.anytime import Course
from harness.solver.branches import Branches
from harness.solver.search import N_NODES, Graph


def policy_arrays(course: Course) -> dict[str, NDArray[Any]]:
    """The lower bound's policy from the start.

    Nodes are numbered from 0, the root. ``action`` (nodes,) is what a node does; its children are the entries
    ``first … first of the next − 1`` of ``edge_visible``, ``edge_reading`` (the next visible value and reading, −1:
    none) and ``edge_node``. Where there is no child, the policy goes on by the visible value alone: ``fallback`` (V,).
    """
    action, first, visible, reading, node = _reached(course.graph, course.branches)
    return {
        "action": action,
        "first": first.astype(np.int32),
        "edge_visible": visible,
        "edge_reading": reading,
        "edge_node": node,
        "fallback": course.floor_action.astype(np.int16),
    }


@compiled
def _reached(
    g: Graph, b: Branches
) -> tuple[NDArray[np.int16], NDArray[np.int64], NDArray[np.int32], NDArray[np.int32], NDArray[np.int32]]:
    number = np.full(g.counts[N_NODES], -1, dtype=np.int32)
    order = [0]
    action = [np.int16(0) for _ in range(0)]
    first = [np.int64(0)]
    visible = [np.int32(0) for _ in range(0)]
    reading = [np.int32(0) for _ in range(0)]
    node = [np.int32(0) for _ in range(0)]
    number[0] = 0
    done = 0
    while done < len(order):
        i = order[done]
        done += 1
        a = g.action[i]
        action.append(np.int16(a))
        if a >= 0:
            va = g.visible[i] * b.n_actions + a
            edge = g.first_edge[i, a]
            for j in range(b.first_branch[va], b.first_branch[va + 1]):
                c = g.child[edge]
                edge += 1
                if c >= 0 and g.action[c] >= 0:
                    if number[c] < 0:
                        number[c] = len(order)
                        order.append(c)
                    visible.append(b.branch[j].visible)
                    reading.append(b.branch[j].reading)
                    node.append(number[c])
        first.append(np.int64(len(visible)))
    return np.array(action), np.array(first), np.array(visible), np.array(reading), np.array(node)
