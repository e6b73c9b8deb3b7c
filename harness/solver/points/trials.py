"""Trials in the manner of HSVI (Smith and Simmons 2005), on a graph of sparse beliefs that repeat.

A node is a visible value with a belief over the joint hidden value. Below it are alpha vectors, each the value of a
conditional plan: an action, and for every branch a vector that was there before. Above it is the fast informed bound
(:mod:`harness.solver.points.initial`), and the sawtooth under that: the optimal value V* is convex in the belief and
grows in proportion with it, so that if a belief b can spare c of another one, b', then
V*(b) ≤ c·V*(b') + V*(b − c·b') ≤ c·upper(b') + informed(b − c·b'). A trial follows the action of the highest upper
bound and the branch whose bounds are furthest apart in expectation, until they are close, and backs up what it passed.
An action's children are made when it first is the most promising one; until then the fast informed bound speaks for it.

**Why the numbers are bounds, after rounding too.** *Below:* each vector is at most the exact backup of the vectors that
follow it, as the rounding of the sums is below ``slack``, which is taken off; a vector that takes another's place is
nowhere below it. So a vector is at most the value of its plan, whatever the belief, and no node's belief matters for
that. *Above:* a node's belief is rounded to multiples of 2⁻⁴³. V* there and V* at the exact posterior differ by no more
than the span of values times the L1 distance, at most H·2⁻⁴³; that, and the rounding of sums, is below ``far``, added
at every backup, and likewise ``slack`` where the sawtooth is asked (what it drops of a belief is below 2⁻⁵² of it). The
smaller of an old and a new bound, both valid, is kept.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.model.tables import compiled, inlined
from harness.solver.points.steps import Steps
from harness.solver.points.store import (
    FULL,
    N_EDGES,
    N_HELD,
    N_NEXT,
    N_NODES,
    N_VECTORS,
    NO_POINT,
    NONE,
    SNAP,
    TRIALS,
    WORK,
    Nodes,
    Place,
    Vectors,
    coded,
)

DEEPEST = 1000
"""Steps of a trial at most."""
_STALE = 0.1
"""A node's upper bound is compared with the points again when this share of them has moved since."""
_LEAST = 1e-3
"""A vector is made if it lifts the node's lower bound by this share of the gap aimed at."""


class Model(NamedTuple):
    """What the search knows of the domain."""

    steps: Steps
    informed: NDArray[np.float64]
    """(V, A, H) the fast informed bound"""
    certain: NDArray[np.float64]
    """(V, H) its best action: where the hidden value is known"""
    slack: float
    far: float


class Scratch(NamedTuple):
    """Room for intermediate results."""

    dense: NDArray[np.float64]
    """(H,) a belief; zero between uses"""
    touched: NDArray[np.int32]
    """(H,) where it is not"""
    to: NDArray[np.int32]
    """(entries of the largest choice,) hidden values that branches lead to"""
    share: NDArray[np.float64]
    """(entries of the largest choice,) and their probabilities"""
    start: NDArray[np.int64]
    """(most branches + 1,) where each branch begins there"""
    path: NDArray[np.int64]
    """(DEEPEST,) nodes of the trial"""


def scratch(s: Steps) -> Scratch:
    """Enough for this model."""
    live = s.size > 0
    entries = (s.first_entry[s.first_row[1:]] - s.first_entry[s.first_row[:-1]])[live] * (s.n_hidden // s.size[live])
    largest, widest = int(entries.max(initial=0)), int(np.diff(s.first_branch).max(initial=0))
    return Scratch(
        np.zeros(s.n_hidden),
        np.zeros(s.n_hidden, dtype=np.int32),
        np.zeros(largest, dtype=np.int32),
        np.zeros(largest),
        np.zeros(widest + 1, dtype=np.int64),
        np.zeros(DEEPEST, dtype=np.int64),
    )


@inlined
def _informed_at(m: Model, v: Place, c: Scratch, count: Place) -> float:
    """The fast informed bound at the unnormalised belief ``dense``, not zero at the first ``count`` touched."""
    best = -np.inf
    for a in range(m.informed.shape[1]):
        total = 0.0
        for t in range(count):
            total += c.dense[c.touched[t]] * m.informed[v, a, c.touched[t]]
        best = max(best, total)
    return best


@compiled
def _above(m: Model, g: Nodes, c: Scratch, v: Place, low: Place, high: Place, myself: Place) -> float:
    """Upper bound at the belief at ``low … high − 1``: the fast informed one, or by the point that saves most."""
    count, signature = high - low, np.uint64(0)
    for t in range(count):
        h = g.hidden[low + t]
        c.touched[t], c.dense[h] = h, g.weight[low + t]
        signature |= np.uint64(1) << np.uint64(h & 63)
    found = _informed_at(m, v, c, np.int64(count))
    best, gain, share, asked = NONE, 0.0, 0.0, 0
    i = g.head[v]
    while i >= 0:
        asked += 1
        if (g.signature[i] & ~signature) == 0 and g.excess[i] > gain and i != myself:
            ratio = 1.0
            for e in range(g.first[i], g.first[i + 1]):
                ratio = min(ratio, c.dense[g.hidden[e]] / g.weight[e])
                if ratio * g.excess[i] <= gain:
                    break
            if ratio * g.excess[i] > gain:
                best, gain, share = i, ratio * g.excess[i], ratio
        i = g.following[i]
    if best >= 0:
        for e in range(g.first[best], g.first[best + 1]):
            h = g.hidden[e]
            left = c.dense[h] - share * g.weight[e]
            c.dense[h] = left if left > 2.0**-52 * c.dense[h] else 0.0
        found = min(found, share * g.upper[best] + _informed_at(m, v, c, np.int64(count)))
    for t in range(count):
        c.dense[c.touched[t]] = 0.0
    g.counts[WORK] += asked + count * m.informed.shape[1]
    return found + m.slack


@compiled
def _below(g: Nodes, w: Vectors, i: Place) -> None:
    """Compare node ``i`` with the vectors that are younger than those it has seen."""
    j, low, high, asked = w.head[g.visible[i]], g.first[i], g.first[i + 1], 0
    while j > g.seen[i]:
        total = 0.0
        for e in range(low, high):
            total += g.weight[e] * w.value[j, g.hidden[e]]
        if total > g.lower[i]:
            g.lower[i], g.best[i] = total, j
        j = w.older[j]
        asked += 1
    g.seen[i] = w.head[g.visible[i]]
    g.counts[WORK] += asked * (high - low)


@compiled
def node_of(m: Model, g: Nodes, w: Vectors, c: Scratch, v: Place) -> int:
    """The node of the belief that has been put behind the last node's; made if there is none. There must be room."""
    i = g.counts[N_NODES]
    low, high = g.first[i], g.counts[N_HELD]
    code, signature = coded(g, v, low, high)
    mask = len(g.table) - 1
    slot = code & mask
    while g.table[slot] >= 0:
        k = g.table[slot]
        same = g.visible[k] == v and g.first[k + 1] - g.first[k] == high - low
        for e in range(high - low if same else 0):
            at = g.first[k] + e
            if g.hidden[low + e] != g.hidden[at] or g.weight[low + e] != g.weight[at]:
                same = False
                break
        if same:
            g.counts[N_HELD] = low
            return int(k)
        slot = (slot + 1) & mask
    g.table[slot] = i
    g.counts[N_NODES] += 1
    g.first[i + 1], g.visible[i], g.signature[i] = high, v, signature
    g.upper[i], g.stamp[i] = _above(m, g, c, v, low, high, np.int64(NONE)), g.version[v]
    for a in range(g.ahead.shape[1]):
        total = 0.0
        for e in range(low, high):
            total += g.weight[e] * m.informed[v, a, g.hidden[e]]
        g.ahead[i, a] = total + m.slack
    g.lower[i] = -np.inf
    _below(g, w, i)
    return int(i)


@inlined
def _hold(g: Nodes, c: Scratch, count: Place, total: float) -> None:
    """Put ``dense / total``, not zero at the ``count`` touched, behind the last node's belief, in order and rounded."""
    if count * 16 < len(c.dense):
        for t in range(1, count):
            h, p = c.touched[t], t
            while p > 0 and c.touched[p - 1] > h:
                c.touched[p] = c.touched[p - 1]
                p -= 1
            c.touched[p] = h
    else:
        t = 0
        for h in range(len(c.dense)):
            if c.dense[h] > 0.0:
                c.touched[t] = h
                t += 1
    at, largest, rest = g.counts[N_HELD], NONE, 1.0
    for t in range(count):
        p = np.floor(c.dense[c.touched[t]] / total * SNAP + 0.5) / SNAP
        c.dense[c.touched[t]] = 0.0
        if p > 0.0:
            g.hidden[at], g.weight[at] = c.touched[t], p
            if largest < 0 or p > g.weight[largest]:
                largest = at
            rest -= p
            at += 1
    g.weight[largest] += rest
    g.counts[N_HELD] = at


@compiled
def _expand(m: Model, g: Nodes, w: Vectors, c: Scratch, i: Place, a: Place) -> bool:
    """Make the children of an action; False where there is no room for them."""
    s = m.steps
    va = g.visible[i] * s.n_actions + a
    branches, low, high = s.first_branch[va + 1] - s.first_branch[va], g.first[i], g.first[i + 1]
    c.start[: branches + 1] = 0
    paid, held = 0.0, 0
    for e in range(low, high):
        row = s.first_row[va] + g.hidden[e] // s.stride[va] % s.size[va]
        paid += g.weight[e] * s.reward[row]
        for k in range(s.first_entry[row], s.first_entry[row + 1]):
            c.start[s.branch[k] + 1] += 1
            held += 1
    edge = g.counts[N_EDGES]
    g.counts[WORK] += 4 * held + branches
    if (
        g.counts[N_NODES] + branches > len(g.visible)
        or g.counts[N_HELD] + held > len(g.hidden)
        or edge + branches + 1 > len(g.child)
    ):
        g.counts[FULL] = 1
        return False
    for j in range(branches):
        c.start[j + 1] += c.start[j]
    for e in range(low, high):
        row = s.first_row[va] + g.hidden[e] // s.stride[va] % s.size[va]
        for k in range(s.first_entry[row], s.first_entry[row + 1]):
            at = c.start[s.branch[k]]
            c.start[s.branch[k]] += 1
            c.to[at], c.share[at] = g.hidden[e] + s.shift[k], g.weight[e] * s.probability[k]
    g.first_edge[i, a], g.probability[edge], g.child[edge] = edge, paid, NONE
    g.counts[N_EDGES] += branches + 1
    begin = 0
    for j in range(branches):
        total, count = 0.0, 0
        for at in range(begin, c.start[j]):  # by now it is where the branch ends
            if c.dense[c.to[at]] == 0.0 and c.share[at] > 0.0:
                c.touched[count] = c.to[at]
                count += 1
            c.dense[c.to[at]] += c.share[at]
            total += c.share[at]
        begin = c.start[j]
        edge += 1
        g.probability[edge], g.child[edge] = total, NONE
        if count > 0:
            _hold(g, c, np.int64(count), total)
            g.child[edge] = node_of(m, g, w, c, np.int64(s.branch_visible[s.first_branch[va] + j]))
    return True


@inlined
def _standing(w: Vectors, j: Place) -> Place:
    """The vector itself, or what took its place."""
    while w.instead[j] >= 0:
        j = np.int64(w.instead[j])
    return j


@compiled
def enlist(w: Vectors, new: Place) -> int:
    """Put a vector into its visible value's list and take out those that it is nowhere below; steps it took."""
    v, work = w.visible[new], 0
    before, j = np.int64(NONE), np.int64(w.head[v])
    while j >= 0:
        h = 0
        while h < w.value.shape[1] and w.value[new, h] >= w.value[j, h]:
            h += 1
        work += h + 1
        if h < w.value.shape[1]:
            before = j
        else:
            w.instead[j] = new
            if before < 0:
                w.head[v] = w.older[j]
            else:
                w.older[before] = w.older[j]
        j = np.int64(w.older[j])
    w.older[new] = w.head[v]
    w.head[v] = new
    if w.default[v] < 0 or w.total[new] > w.total[w.default[v]]:
        w.default[v] = new
    return work


@compiled
def _add_vector(m: Model, g: Nodes, w: Vectors, i: Place, a: Place) -> None:
    """Lift node ``i`` by the vector of action ``a`` followed by the children's best ones, if it does and there is room.

    After a branch that is impossible at this belief follows the vector of the largest sum.
    """
    s = m.steps
    va = g.visible[i] * s.n_actions + a
    branches, new, begin = s.first_branch[va + 1] - s.first_branch[va], g.counts[N_VECTORS], g.counts[N_NEXT]
    if new + 1 > len(w.visible) or begin + branches > len(w.next):
        g.counts[FULL] = 1
        return
    for j in range(branches):
        k = g.child[g.first_edge[i, a] + 1 + j]
        follows = g.best[k] if k >= 0 else w.default[s.branch_visible[s.first_branch[va] + j]]
        w.next[begin + j] = _standing(w, np.int64(follows))
    total, work = 0.0, 0
    for h in range(s.n_hidden):
        row, ahead = s.first_row[va] + h // s.stride[va] % s.size[va], 0.0
        for e in range(s.first_entry[row], s.first_entry[row + 1]):
            ahead += s.probability[e] * w.value[w.next[begin + s.branch[e]], h + s.shift[e]]
        w.value[new, h] = s.reward[row] + s.discount * ahead - m.slack
        total += w.value[new, h]
        work += s.first_entry[row + 1] - s.first_entry[row] + 1
    mine = 0.0
    for e in range(g.first[i], g.first[i + 1]):
        mine += g.weight[e] * w.value[new, g.hidden[e]]
    if mine > g.lower[i]:
        w.visible[new], w.action[new], w.total[new], w.first[new + 1] = g.visible[i], a, total, begin + branches
        g.counts[N_VECTORS] += 1
        g.counts[N_NEXT] += branches
        g.lower[i], g.best[i] = mine, new
        work += enlist(w, new)
    g.counts[WORK] += work


@compiled
def _backup(m: Model, g: Nodes, w: Vectors, i: Place, least: float) -> None:
    """Bounds of node ``i`` from its children; below, only if that lifts it by more than ``least``."""
    s, v = m.steps, g.visible[i]
    highest, best, chosen = -np.inf, -np.inf, 0
    _below(g, w, i)
    for a in range(s.n_actions):
        edge = g.first_edge[i, a]
        if edge >= 0:
            va = v * s.n_actions + a
            low = high = g.probability[edge]
            for e in range(edge + 1, edge + 1 + s.first_branch[va + 1] - s.first_branch[va]):
                k = np.int64(g.child[e])
                if k >= 0:
                    _below(g, w, k)
                    low += s.discount * g.probability[e] * g.lower[k]
                    high += s.discount * g.probability[e] * g.upper[k]
            g.ahead[i, a] = min(g.ahead[i, a], high + m.far)
            if low > best:
                best, chosen = low, a
        highest = max(highest, g.ahead[i, a])
    if best > g.lower[i] + least:
        _add_vector(m, g, w, i, np.int64(chosen))
    if highest < g.upper[i]:
        base = 0.0
        for e in range(g.first[i], g.first[i + 1]):
            base += g.weight[e] * m.certain[v, g.hidden[e]]
        g.upper[i], g.excess[i] = highest, base - highest
        g.version[v] += 1
        if g.following[i] == NO_POINT:
            g.following[i], g.head[v] = g.head[v], i


@compiled
def _refresh(m: Model, g: Nodes, w: Vectors, c: Scratch, i: Place) -> None:
    """Bring the news to a node: all vectors, and the points if many of them moved."""
    v = np.int64(g.visible[i])
    if g.version[v] > g.stamp[i] * (1.0 + _STALE):
        g.stamp[i] = g.version[v]
        g.upper[i] = min(g.upper[i], _above(m, g, c, v, g.first[i], g.first[i + 1], i))
    _below(g, w, i)


@compiled
def trials(
    m: Model,
    g: Nodes,
    w: Vectors,
    c: Scratch,
    root: NDArray[np.int64],
    share: NDArray[np.float64],
    gap: float,
    most: int,
) -> None:
    """Trials until the bounds are within ``gap``, about ``most`` steps of work are done, or room is lacking.

    ``root`` (roots,): nodes that episodes begin at, each with probability ``share``.
    """
    s, end = m.steps, g.counts[WORK] + most
    g.counts[FULL] = 0
    while g.counts[WORK] < end and g.counts[FULL] == 0:
        i, apart, furthest = np.int64(NONE), 0.0, 0.0
        for r in range(len(root)):
            difference = share[r] * (g.upper[root[r]] - g.lower[root[r]])
            apart += difference
            if difference > furthest:
                i, furthest = root[r], difference
        if apart <= gap:
            break
        aim, depth = max(0.5 * gap, 0.9 * (g.upper[i] - g.lower[i])), 0
        while i >= 0 and depth < len(c.path) and g.counts[WORK] < end:
            _refresh(m, g, w, c, i)
            if g.upper[i] - g.lower[i] <= aim:
                break
            best = np.int64(0)
            for a in range(1, s.n_actions):
                if g.ahead[i, a] > g.ahead[i, best]:
                    best = np.int64(a)
            if g.first_edge[i, best] < 0 and not _expand(m, g, w, c, i, best):
                break
            c.path[depth] = i
            depth += 1
            aim /= s.discount
            va, edge = g.visible[i] * s.n_actions + best, g.first_edge[i, best] + 1
            i, furthest = np.int64(NONE), 0.0
            for e in range(edge, edge + s.first_branch[va + 1] - s.first_branch[va]):
                k = np.int64(g.child[e])
                if k >= 0:
                    _refresh(m, g, w, c, k)
                    excess = g.probability[e] * (g.upper[k] - g.lower[k] - aim)
                    if excess > furthest:
                        i, furthest = k, excess
        g.counts[TRIALS] += 1
        g.counts[WORK] += 1 + depth * s.n_actions
        while depth > 0:
            depth -= 1
            _backup(m, g, w, c.path[depth], _LEAST * gap)
