"""DESPOT's tree: what every policy would meet in K scenarios, with bounds of what it earns there.

A scenario is a hidden part drawn from the belief and a uniform number for every step ahead, so that an action has one
outcome. A node is a history that some scenarios share; nodes branch on what is visible next and what is read.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.model.domain import Domain
from harness.model.indexing import strides
from harness.model.splitmix import uniform_at
from harness.model.tables import Records, compiled, draw_labels, draw_outcome, draw_reading, inlined
from harness.policy.planner.hindsight import seen_through
from harness.policy.planner.simulating import Model, model_of
from harness.solver.branches import branches_of
from harness.solver.floor import robust

NODE = np.dtype(
    [
        ("visible", np.int32),
        ("reading", np.int32),
        ("depth", np.int32),
        ("edge", np.int32),  # that it hangs on, −1 for the root
        ("edges", np.int32),  # the first of its own, −1 for a leaf
        ("first", np.int32),  # its scenarios lie together
        ("count", np.int32),
        ("default", np.float64),  # ℓ₀, what the default policy earns
        ("hope", np.float64),  # U₀, less nothing for its size
        ("lower", np.float64),  # ℓ
        ("upper", np.float64),  # μ
    ],
    align=True,
)
"""A history. Its values are weighed by γ^depth / K, so that a sum over leaves is a value at the root."""
EDGE = np.dtype(
    [
        ("node", np.int32),
        ("child", np.int32),  # the first; they lie together
        ("children", np.int32),
        ("paid", np.float64),  # ρ: the step's weighed rewards less λ
        ("lower", np.float64),
        ("upper", np.float64),
    ],
    align=True,
)
"""An action at a history."""
SCENARIO = np.dtype([("number", np.int32), ("hidden", np.int32)], align=True)
"""One scenario at a node, and the index of its joint hidden part there."""

_ENTRIES = 4_000_000  # scenarios at all nodes together: 32 MB
_NODES = 500_000


class Bounds(NamedTuple):
    """What any scenario of a domain earns at least and at most from a state on."""

    floor: NDArray[np.float64]
    """(V,) what the default policy earns whatever is hidden."""
    action: NDArray[np.int32]
    """(V,) by which action."""
    ceiling: NDArray[np.float64]
    """(V, H) :func:`.seen_through`."""
    strides: NDArray[np.int64]
    sizes: NDArray[np.int64]
    """(K,) of the hidden factors."""

    def __deepcopy__(self, memo: object) -> Bounds:
        """Itself: nobody writes to it."""
        return self


class Tree(NamedTuple):
    """One tree; ``used``: how many nodes, edges and scenario entries it has."""

    nodes: Records
    edges: Records
    scenarios: Records
    used: NDArray[np.int64]
    place: NDArray[np.int32]
    """(scenarios, 2) scratch: the child and the hidden part of each scenario."""


@lru_cache(maxsize=1)  # a minute's work on rocksample-15x15, which a sweep asks for at every point
def bounds_of(domain: Domain) -> Bounds:
    """The bounds of a domain: the default policy is the best of those that need to know nothing hidden."""
    floor, action = robust(branches_of(domain), 1e-6)
    sizes = np.array(domain.factor_sizes, dtype=np.int64)
    return Bounds(floor, action.astype(np.int32), seen_through(domain), strides(domain.factor_sizes), sizes)


def empty_tree(scenarios: int) -> Tree:
    """Room for a tree; pages that are not touched take no memory."""
    return Tree(
        np.empty(_NODES, NODE),
        np.empty(_NODES, EDGE),
        np.empty(_ENTRIES, SCENARIO),
        np.zeros(3, dtype=np.int64),
        np.zeros((scenarios, 2), dtype=np.int32),
    )


@compiled
def plant(
    m: Model, b: Bounds, tree: Tree, v: int, marginals: NDArray[np.float64], seed: np.uint64, penalty: float
) -> None:
    """Begin a tree at ``v`` with scenarios whose hidden parts are drawn from the belief ``marginals`` (N,)."""
    nodes, scenarios, n = tree.nodes, tree.scenarios, len(tree.place)
    offset, strides = m.factor_offset, b.strides
    for i in range(n):
        hidden = 0
        for k in range(len(strides)):
            u = uniform_at(seed, i * len(strides) + k)
            total, value = 0.0, 0
            for x in range(offset[k + 1] - offset[k]):
                if marginals[offset[k] + x] > 0.0:
                    value = x
                    total += marginals[offset[k] + x]
                    if u < total:
                        break
            hidden += value * strides[k]
        scenarios[i].number, scenarios[i].hidden = i, hidden
    nodes[0].visible, nodes[0].reading, nodes[0].depth, nodes[0].edge = v, -1, 0, -1
    nodes[0].first, nodes[0].count = 0, n
    tree.used[0], tree.used[1], tree.used[2] = 1, 0, n
    _bound(b.floor, b.ceiling, nodes, scenarios, 0, 1.0 / n, penalty)


@compiled
def _bound(
    floor: NDArray[np.float64],
    ceiling: NDArray[np.float64],
    nodes: Records,
    scenarios: Records,
    node: int,
    weight: float,
    penalty: float,
) -> None:
    """The first bounds of a new leaf, of whose scenarios each weighs ``weight``."""
    v, first, count = nodes[node].visible, nodes[node].first, nodes[node].count
    hope = 0.0
    for i in range(first, first + count):
        hope += ceiling[v, scenarios[i].hidden]
    nodes[node].edges = -1
    nodes[node].default = nodes[node].lower = weight * count * floor[v]
    nodes[node].hope = weight * hope
    nodes[node].upper = max(nodes[node].lower, weight * hope - penalty)


@compiled
def expand(m: Model, b: Bounds, tree: Tree, node: int, stream: np.uint64, penalty: float) -> bool:
    """Try every action in a leaf's scenarios; False, and nothing is done, where the tree has no room for it."""
    nodes, edges, used, n_actions = tree.nodes, tree.edges, tree.used, m.n_actions
    worst = n_actions * nodes[node].count
    if used[0] + worst > len(nodes) or used[1] + n_actions > len(edges) or used[2] + worst > len(tree.scenarios):
        return False
    v, n, first = nodes[node].visible, len(tree.place), used[1]
    weight = m.discount ** nodes[node].depth / n
    nodes[node].edges = first
    used[1] += n_actions
    for a in range(n_actions):
        e = first + a
        edges[e].node, edges[e].child, edges[e].children = node, used[0], 0
        edges[e].lower = edges[e].upper = -np.inf
        if m.allowed[v * n_actions + a]:
            begin = used[0]
            edges[e].paid = weight * _branch(m, b, tree, node, e, v * n_actions + a, stream) - penalty
            edges[e].children = used[0] - begin
            _share_out(tree, node, begin)
            for child in range(begin, used[0]):
                _bound(b.floor, b.ceiling, nodes, tree.scenarios, child, m.discount * weight, penalty)
            sum_up(nodes, edges, e)
    return True


@compiled
def _branch(m: Model, b: Bounds, tree: Tree, node: int, edge: int, va: int, stream: np.uint64) -> float:
    """Make choice ``va`` in all scenarios of a node, and its children; the sum of the rewards."""
    nodes, scenarios, place, used = tree.nodes, tree.scenarios, tree.place, tree.used
    choices, rows, outcomes, reading_cdf = m.choices, m.rows, m.outcomes, m.reading_cdf
    depth, first, k, begin, paid = nodes[node].depth, nodes[node].first, choices[va].factor, used[0], 0.0
    stride = b.strides[k] if k >= 0 else 0
    size = b.sizes[k] if k >= 0 else 1
    for s in range(nodes[node].count):
        hidden = scenarios[first + s].hidden
        x = hidden // stride % size if k >= 0 else 0
        u = uniform_at(stream, scenarios[first + s].number * m.horizon + depth)
        i, left = draw_outcome(rows, outcomes, choices[va].first_row + x, u)
        paid += outcomes[i].reward
        child, after = -1, hidden + (outcomes[i].value - x) * stride
        if not outcomes[i].ends:
            o = draw_reading(reading_cdf, outcomes[i].reading, left)
            if m.sensors is not None:
                there, q = outcomes[i].visible * m.n_actions + va % m.n_actions, outcomes[i].reading
                values = _values(after, b.strides, b.sizes)
                o = draw_labels(m.sensors, m.reading_probability, reading_cdf, q, o, left, there, values, 0)
            child = _child(nodes, used, begin, outcomes[i].visible, o)
            nodes[child].edge, nodes[child].depth = edge, depth + 1
            nodes[child].count += 1
        place[s, 0], place[s, 1] = child, after
    return paid


@inlined
def _values(hidden: int, strides: NDArray[np.int64], sizes: NDArray[np.int64]) -> NDArray[np.int16]:
    """(1, K) values of the factors at a joint one."""
    values = np.empty((1, len(sizes)), dtype=np.int16)
    for k in range(len(sizes)):
        values[0, k] = hidden // strides[k] % sizes[k]
    return values


@compiled
def _child(nodes: Records, used: NDArray[np.int64], begin: int, v: int, o: int) -> int:
    """The node from ``begin`` on that shows ``v`` and ``o``, made where there is none."""
    node = begin
    while node < used[0] and (nodes[node].visible != v or nodes[node].reading != o):
        node += 1
    if node == used[0]:
        nodes[node].visible, nodes[node].reading, nodes[node].count = v, o, 0
        used[0] += 1
    return node


@compiled
def _share_out(tree: Tree, node: int, begin: int) -> None:
    """Give the children from ``begin`` on their scenarios, in the order in which the parent has them."""
    nodes, scenarios, place, used = tree.nodes, tree.scenarios, tree.place, tree.used
    for child in range(begin, used[0]):
        nodes[child].first = used[2]
        used[2] += nodes[child].count
        nodes[child].count = 0
    for s in range(nodes[node].count):
        child = place[s, 0]
        if child >= 0:
            i = nodes[child].first + nodes[child].count
            scenarios[i].number, scenarios[i].hidden = scenarios[nodes[node].first + s].number, place[s, 1]
            nodes[child].count += 1


@compiled
def sum_up(nodes: Records, edges: Records, e: int) -> None:
    """Bounds of an action from those of its histories."""
    lower = upper = edges[e].paid
    for child in range(edges[e].child, edges[e].child + edges[e].children):
        lower += nodes[child].lower
        upper += nodes[child].upper
    edges[e].lower, edges[e].upper = lower, upper


@compiled
def back_up(tree: Tree, n_actions: int, node: int) -> None:
    """Bounds of a node, and of all above it, from those of the actions (Ye et al. 2017, equations 8 and 9)."""
    nodes, edges = tree.nodes, tree.edges
    while node >= 0:
        first = nodes[node].edges
        if first >= 0:
            lower = upper = nodes[node].default
            for e in range(first, first + n_actions):
                lower, upper = max(lower, edges[e].lower), max(upper, edges[e].upper)
            nodes[node].lower, nodes[node].upper = lower, min(upper, nodes[node].upper)
        edge = nodes[node].edge
        if edge >= 0:
            sum_up(nodes, edges, edge)
        node = edges[edge].node if edge >= 0 else -1


def model_and_bounds(domain: Domain, depth: int | None) -> tuple[Model, Bounds]:
    """What a search needs of a domain."""
    return model_of(domain, depth), bounds_of(domain)
