"""What the search has found: nodes, each a visible value with a belief, and alpha vectors; arrays that can grow."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.model.tables import compiled, inlined
from harness.solver.points.steps import Steps

NONE, NO_POINT = -1, -2
"""No node, no vector, the end of a list; a node that is in no list of points."""

N_NODES, N_HELD, N_EDGES, N_VECTORS, N_NEXT, TRIALS, WORK, FULL = range(8)
"""Places in ``counts``: how much is in use of nodes, entries of their beliefs, edges, vectors, what follows these;
trials; elementary steps of all work so far; whether the last trial ended because there was no room."""

SNAP = float(2**43)
"""Beliefs are rounded to multiples of its inverse."""


Place = int | np.signedinteger[Any]
"""A number of something; in compiled code always int64, so that no function is compiled for several widths."""


class Nodes(NamedTuple):
    """Beliefs met so far: M nodes with room; V visible values, A actions."""

    counts: NDArray[np.int64]
    """(8,)"""
    table: NDArray[np.int64]
    """Open addressing: nodes by the hash of what they are, or NONE. A power of two long."""
    head: NDArray[np.int32]
    """(V,) the first of each visible value's sawtooth points, which are nodes whose children have been looked at"""
    version: NDArray[np.int64]
    """(V,) how often one of these points fell"""
    visible: NDArray[np.int32]
    """(M,)"""
    first: NDArray[np.int64]
    """(M + 1,) where the belief begins in ``hidden`` and ``weight``"""
    upper: NDArray[np.float64]
    """(M,)"""
    lower: NDArray[np.float64]
    """(M,)"""
    best: NDArray[np.int32]
    """(M,) the vector that has the lower bound"""
    seen: NDArray[np.int32]
    """(M,) the youngest vector that the node was compared with"""
    stamp: NDArray[np.int64]
    """(M,) version of the points that its upper bound was compared with"""
    excess: NDArray[np.float64]
    """(M,) of a point: how far the bound at certainty, averaged over the belief, is above ``upper``"""
    signature: NDArray[np.uint64]
    """(M,) a bit for each hidden value that is possible, modulo 64"""
    following: NDArray[np.int32]
    """(M,) the next point of the same list, NONE, or NO_POINT"""
    ahead: NDArray[np.float64]
    """(M, A) upper bound of each action"""
    first_edge: NDArray[np.int64]
    """(M, A) of an action: the edge that holds what it pays, followed by one an its branch; NONE where not looked at"""
    hidden: NDArray[np.int32]
    """Hidden values that are possible, rising within a node"""
    weight: NDArray[np.float64]
    """and their probabilities"""
    child: NDArray[np.int32]
    """(edges,) node; NONE where the branch has no probability"""
    probability: NDArray[np.float64]
    """(edges,) of the branch; in an action's first edge the expected reward"""


class Vectors(NamedTuple):
    """Alpha vectors: W with room, H joint hidden values."""

    head: NDArray[np.int32]
    """(V,) the youngest in each visible value's list"""
    default: NDArray[np.int32]
    """(V,) the one with the largest sum"""
    visible: NDArray[np.int32]
    """(W,)"""
    action: NDArray[np.int32]
    """(W,)"""
    total: NDArray[np.float64]
    """(W,) sum"""
    older: NDArray[np.int32]
    """(W,) the next older one of the list, or NONE"""
    instead: NDArray[np.int32]
    """(W,) a younger vector that is nowhere lower and took its place in the list, or NONE"""
    first: NDArray[np.int64]
    """(W + 1,) where what follows begins in ``next``"""
    value: NDArray[np.float64]
    """(W, H)"""
    next: NDArray[np.int32]
    """The vectors that its action's branches lead to, in the order of the branches"""


class Room(NamedTuple):
    """Lengths of the arrays."""

    nodes: int
    held: int
    """Entries of all beliefs"""
    edges: int
    vectors: int
    next: int


_NODES = (
    "visible", "upper", "lower", "best", "seen", "stamp", "excess", "signature", "following", "ahead", "first_edge",
    "first",
)  # fmt: skip
_VECTORS = ("visible", "action", "total", "older", "instead", "value", "first")
_NODE_PARTS: Sequence[tuple[int, Sequence[str]]] = (
    (N_NODES, _NODES),
    (N_HELD, ("hidden", "weight")),
    (N_EDGES, ("child", "probability")),
)
_VECTOR_PARTS: Sequence[tuple[int, Sequence[str]]] = ((N_VECTORS, _VECTORS), (N_NEXT, ("next",)))
_FILL = {"following": NO_POINT, "first_edge": NONE, "best": NONE, "seen": NONE, "older": NONE, "instead": NONE}


def nodes(s: Steps, room: Room) -> Nodes:
    """No nodes, with room for some."""
    n, v, a = room.nodes, s.n_visible, s.n_actions
    return Nodes(
        counts=np.zeros(8, dtype=np.int64),
        table=_table(n),
        head=np.full(v, NONE, dtype=np.int32),
        version=np.zeros(v, dtype=np.int64),
        visible=np.zeros(n, dtype=np.int32),
        first=np.zeros(n + 1, dtype=np.int64),
        upper=np.zeros(n),
        lower=np.zeros(n),
        best=np.full(n, NONE, dtype=np.int32),
        seen=np.full(n, NONE, dtype=np.int32),
        stamp=np.zeros(n, dtype=np.int64),
        excess=np.zeros(n),
        signature=np.zeros(n, dtype=np.uint64),
        following=np.full(n, NO_POINT, dtype=np.int32),
        ahead=np.zeros((n, a)),
        first_edge=np.full((n, a), NONE, dtype=np.int64),
        hidden=np.zeros(room.held, dtype=np.int32),
        weight=np.zeros(room.held),
        child=np.zeros(room.edges, dtype=np.int32),
        probability=np.zeros(room.edges),
    )


def vectors(s: Steps, room: Room) -> Vectors:
    """No vectors, with room for some."""
    n, v = room.vectors, s.n_visible
    return Vectors(
        head=np.full(v, NONE, dtype=np.int32),
        default=np.full(v, NONE, dtype=np.int32),
        visible=np.zeros(n, dtype=np.int32),
        action=np.zeros(n, dtype=np.int32),
        total=np.zeros(n),
        older=np.full(n, NONE, dtype=np.int32),
        instead=np.full(n, NONE, dtype=np.int32),
        first=np.zeros(n + 1, dtype=np.int64),
        value=np.zeros((n, s.n_hidden)),
        next=np.zeros(room.next, dtype=np.int32),
    )


def _table(n: int) -> NDArray[np.int64]:
    return np.full(1 << int(np.ceil(np.log2(2 * n))), NONE, dtype=np.int64)


def size(*arrays: Any) -> int:
    """Bytes of tuples of arrays."""
    return sum(int(each.nbytes) for group in arrays for each in group if isinstance(each, np.ndarray))


def roomier(g: Nodes, w: Vectors, spare: int) -> tuple[Nodes, Vectors]:
    """The same with up to twice the room in what is half full, or in everything if the last trial lacked some.

    ``spare``: bytes that may be taken while both the old arrays and the new ones are there.
    """
    counts, full = g.counts, bool(g.counts[FULL])
    for place, names in _NODE_PARTS:
        longer = _longer(g, names, int(counts[place]), full, spare)
        g, spare = g._replace(**longer), spare - size(longer.values())
        if "visible" in longer:
            g = g._replace(table=_table(len(g.visible)))
            rehash(g)
    for place, names in _VECTOR_PARTS:
        longer = _longer(w, names, int(counts[place]), full, spare)
        w, spare = w._replace(**longer), spare - size(longer.values())
    return g, w


def _longer(group: Any, names: Sequence[str], used: int, full: bool, spare: int) -> dict[str, NDArray[Any]]:
    """Longer copies of the arrays, or none if there is enough room or too little to spare."""
    arrays = {name: getattr(group, name) for name in names}
    room = len(arrays[names[0]])
    table = 2 * 2 * 2 * 8 * room if "upper" in arrays else 0  # of the hashes, at most
    affordable = int(room * (spare - table) / size(arrays.values()))
    new = min(2 * room, affordable)
    if (used <= room // 2 and not full) or new < 1.1 * room:
        return {}
    return {name: _extended(name, array, new + len(array) - room) for name, array in arrays.items()}


def _extended(name: str, array: NDArray[Any], n: int) -> NDArray[Any]:
    longer = np.full((n, *array.shape[1:]), _FILL.get(name, 0), dtype=array.dtype)
    longer[: len(array)] = array
    return longer


@inlined
def coded(g: Nodes, v: Place, low: Place, high: Place) -> tuple[np.int64, np.uint64]:
    """Hash and signature of visible value ``v`` with the belief at ``low … high − 1``."""
    code, signature = np.uint64(v) * np.uint64(0x9E3779B97F4A7C15), np.uint64(0)
    for e in range(low, high):
        code = (code ^ np.uint64(g.hidden[e])) * np.uint64(0xBF58476D1CE4E5B9)
        code ^= code >> np.uint64(29)
        code = (code ^ np.uint64(np.int64(g.weight[e] * SNAP))) * np.uint64(0x94D049BB133111EB)
        code ^= code >> np.uint64(31)
        signature |= np.uint64(1) << np.uint64(g.hidden[e] & 63)
    return np.int64(code >> np.uint64(1)), signature


@compiled
def rehash(g: Nodes) -> None:
    """Fill an empty table."""
    mask = len(g.table) - 1
    for i in range(g.counts[N_NODES]):
        slot = coded(g, np.int64(g.visible[i]), g.first[i], g.first[i + 1])[0] & mask
        while g.table[slot] >= 0:
            slot = (slot + 1) & mask
        g.table[slot] = i
