"""A search tree over histories in two record arrays of a fixed size; the root is node 0."""

from __future__ import annotations

import numpy as np

from harness.model.tables import Records, compiled, inlined

NODE = np.dtype(
    [
        ("visible", np.int32),
        ("reading", np.int32),
        ("edge", np.int32),  # that it hangs on: parent · A + action
        ("sibling", np.int32),  # next node on the same edge, −1 for none
        ("visits", np.int32),
        ("moved", np.int32),  # where it goes when the tree is cut, −1 for nowhere
    ],
    align=True,
)
"""A history: what is visible and has been read at its end."""
EDGE = np.dtype([("value", np.float64), ("visits", np.int32), ("child", np.int32)], align=True)
"""An action at a history: its mean return, and the first of the histories that followed. Entry node · A + action."""

NODES_MOST = 200_000
"""Nodes of a tree; a larger number of simulations goes on in the tree that there is."""


def nodes_for(simulations: int) -> int:
    """Room for the nodes of a step's simulations and for as many kept from the steps before."""
    return min(NODES_MOST, 2 * simulations + 1)


def tree_bytes(nodes: int, n_actions: int) -> int:
    """Memory of one tree."""
    return nodes * (NODE.itemsize + n_actions * EDGE.itemsize)


@inlined
def add_node(nodes: Records, edges: Records, n_actions: int, node: int, edge: int, v: int, o: int, old: int) -> None:
    """Make ``node`` the history after ``edge`` (−1: the root) that ends with visible value ``v`` and reading ``o``.

    Its actions are as known as those of node ``old``, which may lie where it is put; −1: nothing is known of them.
    """
    nodes[node].visible = v
    nodes[node].reading = o
    nodes[node].edge = edge
    nodes[node].visits = 0
    nodes[node].sibling = -1
    if edge >= 0:
        nodes[node].sibling = edges[edge].child
        edges[edge].child = node
    for a in range(n_actions):
        j = node * n_actions + a
        edges[j].value = 0.0 if old < 0 else edges[old * n_actions + a].value
        edges[j].visits = 0 if old < 0 else edges[old * n_actions + a].visits
        edges[j].child = -1


@inlined
def child_of(nodes: Records, edges: Records, edge: int, v: int, o: int) -> int:
    """The history after ``edge`` that ends with ``v`` and ``o``; −1 if there is none yet."""
    node = edges[edge].child
    while node >= 0 and (nodes[node].visible != v or nodes[node].reading != o):
        node = nodes[node].sibling
    return int(node)


@compiled
def advance(nodes: Records, edges: Records, n_actions: int, used: int, a: int, v: int, o: int) -> int:
    """Make the history after action ``a`` with ``v`` and ``o`` the root, drop all others; how many nodes are left.

    A node has a larger number than its parent, so that one pass in order moves every kept node to the front.
    """
    root = child_of(nodes, edges, a, v, o) if used > 0 else -1
    if root < 0:
        add_node(nodes, edges, n_actions, 0, -1, v, o, -1)
        return 1
    for node in range(root):
        nodes[node].moved = -1
    kept = 0
    for node in range(root, used):
        edge = nodes[node].edge
        up = -1 if node == root else nodes[edge // n_actions].moved
        nodes[node].moved = -1
        if node == root or up >= 0:
            visits = nodes[node].visits
            hangs_on = -1 if up < 0 else up * n_actions + edge % n_actions
            add_node(nodes, edges, n_actions, kept, hangs_on, nodes[node].visible, nodes[node].reading, node)
            nodes[kept].visits = visits
            nodes[node].moved = kept
            kept += 1
    return kept
