"""Trials over exact beliefs, in the manner of HSVI (Smith and Simmons 2004), on a graph of beliefs that repeat.

A node is a visible value with the marginals of all factors: an exact belief, as factors are independent. It holds a
lower and an upper bound of V*. A trial follows the action of the highest upper bound and the branch whose bounds are
furthest apart in expectation, until they are close, and backs up what it passed. Leaves have the product grid's value
above (:mod:`harness.solver.grid`) and below what a blind plan earns (:mod:`harness.solver.plans`).

**Rounding.** The posterior of a step is rounded to multiples of 2⁻⁴³, so that beliefs reached in another order of
readings are the same node. A node's belief is what it holds: V* there and V* at the exact posterior differ by no more
than the span of values times the L1 distance, which is below n·2⁻⁴³ for a factor of n values. That, and the rounding of
the sums, is below ``slack``, which every backup takes off the lower and adds to the upper bound. The bounds of the root
are therefore bounds of V* at the start.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.model.tables import compiled, lean
from harness.solver.branches import Branches
from harness.solver.grid import grid_value
from harness.solver.lookahead import SNAP, Model, action_value, expected_reward, look_ahead, posterior
from harness.solver.plans import LONGEST, follow

ENDS, NEVER = -1, -2
"""Children that are none: the episode ends; the branch has no probability."""

N_NODES, N_EDGES, TRIALS = 0, 1, 2

DEEPEST = 1000
"""Steps of a trial at most."""


class Graph(NamedTuple):
    """The nodes met so far, with room for more; node 0 is the root. M nodes, A actions, N marginals."""

    visible: NDArray[np.int32]
    belief: NDArray[np.float64]
    """(M, N)"""
    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    action: NDArray[np.int16]
    """(M,) that gave the lower bound; −1: the blind plan."""
    ahead: NDArray[np.float64]
    """(M, A) upper bound of each action; inf where not looked at yet."""
    looked: NDArray[np.bool_]
    """(M,) whether the grid as it is has been asked what the actions lead to."""
    sharp: NDArray[np.bool_]
    """(M, A) whether that was the sharper grid, not the quick one"""
    first_edge: NDArray[np.int64]
    """(M, A) of an action's children, in the order of its branches; −1 where it has none yet."""
    child: NDArray[np.int64]
    """(edges,) node, or ENDS or NEVER."""
    probability: NDArray[np.float64]
    """(edges,)"""
    table: NDArray[np.int64]
    """Open addressing: nodes by the hash of what they are; −1: free. A power of two long."""
    counts: NDArray[np.int64]
    """(3,) nodes, edges, trials"""


def empty(b: Branches, nodes: int, edges: int) -> Graph:
    """A graph without nodes, with room for so many."""
    n = int(b.factor_offset[-1])
    return Graph(
        np.zeros(nodes, dtype=np.int32),
        np.zeros((nodes, n)),
        np.zeros(nodes),
        np.zeros(nodes),
        np.full(nodes, -1, dtype=np.int16),
        np.full((nodes, b.n_actions), np.inf),
        np.zeros(nodes, dtype=np.bool_),
        np.zeros((nodes, b.n_actions), dtype=np.bool_),
        np.full((nodes, b.n_actions), -1, dtype=np.int64),
        np.zeros(edges, dtype=np.int64),
        np.zeros(edges),
        np.full(1 << int(np.ceil(np.log2(2 * nodes))), -1, dtype=np.int64),
        np.zeros(3, dtype=np.int64),
    )


def grown(graph: Graph, b: Branches, nodes: int, edges: int) -> Graph:
    """The same graph with room for more."""
    larger = empty(b, nodes, edges)
    for name in ("visible", "belief", "lower", "upper", "action", "ahead", "looked", "sharp", "first_edge"):
        getattr(larger, name)[: graph.counts[N_NODES]] = getattr(graph, name)[: graph.counts[N_NODES]]
    for name in ("child", "probability"):
        getattr(larger, name)[: graph.counts[N_EDGES]] = getattr(graph, name)[: graph.counts[N_EDGES]]
    larger.counts[:] = graph.counts
    _rehash(larger)
    return larger


@compiled
def _rehash(g: Graph) -> None:
    mask = len(g.table) - 1
    for i in range(g.counts[N_NODES]):
        slot = _hash(g.visible[i], g.belief[i]) & mask
        while g.table[slot] >= 0:
            slot = (slot + 1) & mask
        g.table[slot] = i


@lean
def _hash(v: int, belief: NDArray[np.float64]) -> np.int64:
    h = np.uint64(v) * np.uint64(0x9E3779B97F4A7C15)
    for x in range(len(belief)):
        h = (h ^ np.uint64(np.int64(belief[x] * SNAP))) * np.uint64(0xBF58476D1CE4E5B9)
        h ^= h >> np.uint64(29)
    return np.int64(h >> np.uint64(1))


@compiled
def node_of(g: Graph, m: Model, v: int, belief: NDArray[np.float64]) -> int:
    """The node of an exact belief, made if there is none; there must be room for it."""
    mask = len(g.table) - 1
    slot = _hash(v, belief) & mask
    while g.table[slot] >= 0:
        i = g.table[slot]
        if g.visible[i] == v:
            same = True
            for x in range(len(belief)):
                if g.belief[i, x] != belief[x]:
                    same = False
            if same:
                return int(i)
        slot = (slot + 1) & mask
    i = g.counts[N_NODES]
    g.counts[N_NODES] += 1
    g.table[slot] = i
    g.visible[i] = v
    g.belief[i] = belief
    value, length = follow(m.branches, m.plans, m.floor, v, belief, np.empty((LONGEST, 2), dtype=np.int32))
    g.lower[i] = value - m.slack if length > 0 else value
    g.upper[i] = max(g.lower[i], grid_value(m.above, m.branches.factor_offset, v, belief))
    return int(i)


@compiled
def _look(g: Graph, m: Model, i: int) -> None:
    """Upper bounds of all actions of node ``i`` from the base one step ahead."""
    values = np.empty(m.branches.n_actions)
    look_ahead(m.branches, m.above, g.visible[i], g.belief[i], values)
    for a in range(len(values)):
        g.ahead[i, a] = min(g.ahead[i, a], values[a] + m.slack)
        g.sharp[i, a] = len(m.above.table) == 0
    g.looked[i] = True


@compiled
def _best(g: Graph, m: Model, i: int) -> int:
    """The action of the highest upper bound, when the sparse grid has been asked of all that were higher."""
    while True:
        best = int(np.argmax(g.ahead[i]))
        if g.sharp[i, best] or g.first_edge[i, best] >= 0:
            return best
        value = action_value(m.branches, m.above, g.visible[i], g.belief[i], best)
        g.ahead[i, best], g.sharp[i, best] = min(g.ahead[i, best], value + m.slack), True


@compiled
def _expand(g: Graph, m: Model, i: int, a: int) -> None:
    """Make the children of an action."""
    b = m.branches
    v, before = g.visible[i], g.belief[i].copy()
    va = v * b.n_actions + a
    k = b.factor[va]
    n = 1 if k < 0 else b.factor_offset[k + 1] - b.factor_offset[k]
    first = 0 if k < 0 else b.factor_offset[k]
    edge = g.counts[N_EDGES]
    g.first_edge[i, a] = edge
    g.counts[N_EDGES] += b.first_branch[va + 1] - b.first_branch[va]
    after = before.copy()
    for j in range(b.first_branch[va], b.first_branch[va + 1]):
        p = posterior(b, j, n, k, before, first, after)
        g.probability[edge] = p
        if p <= 0.0:
            g.child[edge] = NEVER
        elif b.branch[j].ends:
            g.child[edge] = ENDS
        else:
            g.child[edge] = node_of(g, m, b.branch[j].visible, after)
        edge += 1


@compiled
def _backup(g: Graph, m: Model, i: int) -> None:
    """Bounds of node ``i`` from its children, as far as its actions have any."""
    b, slack, discount = m.branches, m.slack, m.branches.discount
    first_edge, child, probability, lower, upper, ahead = (
        g.first_edge, g.child, g.probability, g.lower, g.upper, g.ahead
    )  # fmt: skip
    v, first_branch = g.visible[i], b.first_branch
    for a in range(b.n_actions):
        edge = first_edge[i, a]
        if edge >= 0:
            va = v * b.n_actions + a
            low = high = expected_reward(b, v, g.belief[i], a)
            for e in range(edge, edge + first_branch[va + 1] - first_branch[va]):
                c = child[e]
                if c >= 0:
                    low += discount * probability[e] * lower[c]
                    high += discount * probability[e] * upper[c]
            ahead[i, a] = min(ahead[i, a], high + slack)
            if low - slack > lower[i]:
                lower[i], g.action[i] = low - slack, a
    upper[i] = min(upper[i], max(ahead[i, _best(g, m, i)] + slack, lower[i]))


@compiled
def kept(g: Graph, b: Branches) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Nodes that the lower bound's policy can reach, the root first, and (M,) their places among them; −1: not."""
    place = np.full(g.counts[N_NODES], -1, dtype=np.int64)
    order = [np.int64(0)]
    place[0] = 0
    done = 0
    while done < len(order):
        i = order[done]
        done += 1
        if g.action[i] >= 0:
            va = g.visible[i] * b.n_actions + g.action[i]
            edge = g.first_edge[i, g.action[i]]
            for e in range(edge, edge + b.first_branch[va + 1] - b.first_branch[va]):
                c = g.child[e]
                if c >= 0 and place[c] < 0:
                    place[c] = len(order)
                    order.append(c)
    return np.array(order), place


@compiled
def _keep_edges(g: Graph, b: Branches, order: NDArray[np.int64], place: NDArray[np.int64], kept: Graph) -> None:
    edge = 0
    for i in range(len(order)):
        a = g.action[order[i]]
        if a >= 0:
            va = g.visible[order[i]] * b.n_actions + a
            old = g.first_edge[order[i], a]
            kept.first_edge[i, a] = edge
            for e in range(old, old + b.first_branch[va + 1] - b.first_branch[va]):
                c = g.child[e]
                kept.child[edge] = place[c] if c >= 0 else c
                kept.probability[edge] = g.probability[e]
                edge += 1
    kept.counts[N_EDGES] = edge


def pruned(graph: Graph, b: Branches) -> Graph:
    """The nodes of the lower bound's policy alone: what a looser upper bound made the search look at is forgotten."""
    order, place = kept(graph, b)
    held = empty(b, len(graph.visible), len(graph.child))
    for name in ("visible", "belief", "lower", "upper", "action", "ahead"):
        getattr(held, name)[: len(order)] = getattr(graph, name)[order]
    held.counts[:] = graph.counts
    held.counts[N_NODES] = len(order)
    _keep_edges(graph, b, order, place, held)
    _rehash(held)
    return held


@compiled
def refresh(g: Graph, m: Model) -> None:
    """Bring a tighter grid to all nodes, the later ones first: most children are younger than their parents."""
    for i in range(g.counts[N_NODES] - 1, -1, -1):
        g.looked[i] = False
        g.upper[i] = min(
            g.upper[i], max(g.lower[i], grid_value(m.above, m.branches.factor_offset, g.visible[i], g.belief[i]))
        )
        expanded = False
        for a in range(m.branches.n_actions):
            expanded = expanded or g.first_edge[i, a] >= 0
        if expanded:
            _look(g, m, i)
            _backup(g, m, i)


@compiled
def room(b: Branches) -> int:
    """Nodes, and edges, that one trial may add."""
    widest = 0
    for va in range(b.n_visible * b.n_actions):
        widest = max(widest, b.first_branch[va + 1] - b.first_branch[va])
    return widest * DEEPEST


@compiled
def trials(g: Graph, m: Model, gap: float, most: int) -> int:
    """Up to ``most`` trials from the root, fewer when its bounds are within ``gap`` or the room ends; how many."""
    b, deepest, done, need = m.branches, DEEPEST, 0, room(m.branches)
    path = np.zeros(deepest, dtype=np.int64)
    while done < most and g.upper[0] - g.lower[0] > gap:
        if g.counts[N_NODES] + need > len(g.visible) or g.counts[N_EDGES] + need > len(g.child):
            break
        aim = max(0.5 * gap, 0.9 * (g.upper[0] - g.lower[0]))
        i, depth = 0, 0
        while depth < deepest and g.upper[i] - g.lower[i] > aim:
            path[depth] = i
            depth += 1
            if not g.looked[i]:
                _look(g, m, i)
            best = _best(g, m, i)
            if g.first_edge[i, best] < 0:
                _expand(g, m, i, best)
            aim /= b.discount
            va = g.visible[i] * b.n_actions + best
            edge = g.first_edge[i, best]
            furthest, apart = -1, 0.0
            for e in range(edge, edge + b.first_branch[va + 1] - b.first_branch[va]):
                c = g.child[e]
                if c >= 0:
                    excess = g.probability[e] * (g.upper[c] - g.lower[c] - aim)
                    if excess > apart:
                        furthest, apart = c, excess
            if furthest < 0:
                break
            i = furthest
        while depth > 0:
            depth -= 1
            _backup(g, m, path[depth])
        done += 1
        g.counts[TRIALS] += 1
    return done
