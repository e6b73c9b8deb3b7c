"""The course of solving point by point: bounds to begin with, then trials, with more room whenever it gets narrow.

The work is cut by its amount, not by the clock, so that the bounds after so many blocks are the same on any machine.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.errors import HarnessError
from harness.model.domain import Domain
from harness.model.indexing import spans
from harness.solver.points import initial, store, trials
from harness.solver.points.steps import Start, Steps, entries_of, starts, steps_of
from harness.solver.points.store import N_HELD, N_NEXT, N_NODES, N_VECTORS, TRIALS, Nodes, Room, Vectors
from harness.solver.points.trials import Model, Scratch

_BLOCK = 40_000_000  # steps of work in one call of compiled code: less than a second, so that Ctrl-C is heard
_ROOM = Room(nodes=4096, held=65_536, edges=16_384, vectors=1024, next=8192)  # and what the model itself calls for
LEFT = 0.01
"""Share of the bounds' gap that a stored policy may be worth less than the lower bound (:func:`rounded`)."""
_TIE = 1e-9
"""Vectors whose values are this close count as equal when they are played (:data:`harness.policy.alpha.TIE`)."""


@dataclass(frozen=True)
class Course:
    """Where the work stands; what follows depends on nothing else."""

    domain: Domain
    model: Model
    nodes: Nodes
    vectors: Vectors
    scratch: Scratch
    root: NDArray[np.int64]
    """(roots,) nodes that episodes begin at"""
    share: NDArray[np.float64]
    """(roots,) their probabilities"""
    loss: float
    """What the lower bound may lose by rounding, and by playing a vector that is nearly as good as the best"""

    @property
    def lower(self) -> float:
        """Lower bound of the optimal value at the start, and of what the policy of :func:`arrays` earns."""
        return float(self.share @ self.nodes.lower[self.root]) - self.loss

    @property
    def upper(self) -> float:
        """Upper bound of the optimal value at the start."""
        return float(self.share @ self.nodes.upper[self.root]) + self.model.slack

    @property
    def memory(self) -> int:
        """Bytes of all arrays."""
        model = (self.model.informed, self.model.certain)
        return store.size(self.model.steps, model, self.nodes, self.vectors, self.scratch)

    @property
    def facts(self) -> dict[str, int]:
        """How much has been done."""
        counts = self.nodes.counts
        return {"nodes": int(counts[N_NODES]), "trials": int(counts[TRIALS]), "vectors": int(counts[N_VECTORS])}


def least_memory(domain: Domain) -> int:
    """Bytes that solving takes before the first trial, about."""
    table = 8 * domain.n_visible * domain.n_joint
    return 100 * entries_of(domain) + table * (2 * domain.n_actions + 6)  # entries: while they are being sorted


def begin(domain: Domain) -> Course:
    """The fast informed bound above and policies that act by the visible value alone below.

    Raises:
        HarnessError: the domain cannot be solved this way.
    """
    if not 0 < domain.discount < 1:
        raise HarnessError(f"{domain.name} has discount {domain.discount:g}; solving needs one between 0 and 1")
    s, ways = steps_of(domain), starts(domain)
    slack = initial.slack_of(s)
    informed = initial.bounded_above(s, slack)
    model = Model(s, informed, informed.max(axis=1), slack, slack + s.n_hidden / store.SNAP * s.span)
    c = trials.scratch(s)
    room = _room(s, ways, c)
    g, w = store.nodes(s, room), store.vectors(s, room)
    cautious = initial.cautious(s)
    worst = _follow(s, g, w, cautious, slack)
    for a in range(s.n_actions):
        _follow(s, g, w, np.full(s.n_visible, a), slack)
    root = np.array([_root(model, g, w, c, way) for way in ways], dtype=np.int64)
    share = np.array([way.share for way in ways])
    played = max(1.0, float(informed.max()), -worst)  # no value that is played by is larger, by amount
    return Course(domain, model, g, w, c, root, share, slack + 2.0 * _TIE * played / (1.0 - s.discount))


def _room(s: Steps, ways: list[Start], c: Scratch) -> Room:
    """For the first vectors, the roots and one choice."""
    beginning = sum(int(np.count_nonzero(way.belief)) for way in ways)
    first = s.n_visible * (s.n_actions + 1)
    return Room(
        _ROOM.nodes + len(ways) + len(c.start),
        _ROOM.held + beginning + len(c.to),
        _ROOM.edges + len(c.start),
        _ROOM.vectors + first,
        _ROOM.next + 2 * len(s.branch_visible),
    )


def _follow(s: Steps, g: Nodes, w: Vectors, action: NDArray[np.int64], slack: float) -> float:
    """Vectors of acting by ``action`` (V,), one for each visible value that is no end; the lowest of their values."""
    value = initial.value_of(s, action, slack)
    live = np.flatnonzero(s.size.reshape(s.n_visible, -1)[:, 0])
    number = np.zeros(s.n_visible, dtype=np.int32)
    number[live] = g.counts[N_VECTORS] + np.arange(len(live))
    for v in live:
        new, choice, begin = number[v], v * s.n_actions + action[v], g.counts[N_NEXT]
        after = number[s.branch_visible[s.first_branch[choice] : s.first_branch[choice + 1]]]
        w.visible[new], w.action[new], w.value[new], w.total[new] = v, action[v], value[v], value[v].sum()
        w.next[begin : begin + len(after)] = after
        w.first[new + 1] = begin + len(after)
        trials.enlist(w, int(new))
        g.counts[N_VECTORS] += 1
        g.counts[N_NEXT] += len(after)
    return float(value[live].min(initial=0.0))


def _root(m: Model, g: Nodes, w: Vectors, c: Scratch, way: Start) -> int:
    hidden = np.flatnonzero(way.belief)
    begin = g.counts[N_HELD]
    g.hidden[begin : begin + len(hidden)] = hidden
    g.weight[begin : begin + len(hidden)] = way.belief[hidden]
    g.counts[N_HELD] += len(hidden)
    return int(trials.node_of(m, g, w, c, way.visible))


def blocks(course: Course, gap: float, memory: int) -> Iterator[Course]:
    """Work on until the bounds are within ``gap`` or nothing is left to do; yields after less than a second's work.

    ``memory``: bytes that all arrays may take.
    """
    while course.upper - course.lower > gap:
        before, room = _progress(course), course.memory
        g, w = store.roomier(course.nodes, course.vectors, memory - course.memory)
        course = replace(course, nodes=g, vectors=w)
        aim = max(gap - course.loss - course.model.slack, 0.1 * gap)
        trials.trials(course.model, g, w, course.scratch, course.root, course.share, aim, _BLOCK)
        if _progress(course) == before and course.memory == room:  # as close as rounding or room lets them come
            return
        yield course


def _progress(course: Course) -> tuple[float, float, int, int]:
    counts = course.nodes.counts
    return course.lower, course.upper, int(counts[N_NODES]), int(counts[N_VECTORS])


def rounded(course: Course) -> tuple[dict[str, NDArray[Any]], float]:
    """The policy of :func:`arrays` as it is stored, and by how much less it earns at least.

    Values are rounded down to so few digits that a file takes a quarter of the bytes. With vectors lowered by
    c = γ·step/(1 − γ), then to multiples of ``step``, one is at most its exact value less c, and what it leads to at
    least γ·(c + step) = c less: it still is at most its own backup.
    """
    found, discount = arrays(course), course.domain.discount
    step = 2.0 ** np.floor(np.log2((1.0 - discount) * LEFT * max(course.upper - course.lower, _TIE)))
    units = np.floor(found["values"] / step - discount / (1.0 - discount) * (1.0 + 2.0**-20))
    kind = np.float32 if np.abs(units).max() < 2.0**24 else np.float64  # holds them all to the last digit
    return {**found, "values": (units * step).astype(kind)}, float(step / (1.0 - discount)) * (1.0 + 2.0**-19)


def arrays(course: Course) -> dict[str, NDArray[Any]]:
    """The lower bound's policy: alpha vectors ``values`` (n, H) with their ``visible`` values and ``actions``.

    They are those of the plans at the roots, all that these plans lead to, and what can be had whatever is hidden. So
    each vector is at most the backup, by its own action, of the largest of the others at the next belief; from that
    follows, step by step, that acting by the largest vector earns at least its value, at any belief.
    """
    w = course.vectors
    standing = _standing(w.instead[: course.nodes.counts[N_VECTORS]])
    cautious = np.full(course.domain.n_visible, store.NONE, dtype=np.int64)
    live = np.count_nonzero(course.model.steps.size) // course.model.steps.n_actions
    cautious[w.visible[:live]] = standing[:live]
    kept = np.zeros(len(standing), dtype=np.bool_)
    new = np.unique(standing[course.nodes.best[course.root]])
    while len(new):
        kept[new] = True
        after, _ = spans(w.first[new], w.first[new + 1] - w.first[new])
        new = np.unique([*standing[w.next[after]], *cautious[w.visible[new]]])
        new = new[~kept[new]]
    chosen = np.flatnonzero(kept)
    return {"visible": w.visible[chosen], "actions": w.action[chosen], "values": w.value[chosen]}


def _standing(instead: NDArray[np.int32]) -> NDArray[np.int64]:
    """(n,) of each vector the one that took its place in the end, or itself."""
    standing = np.where(instead >= 0, instead, np.arange(len(instead)))
    while (instead[standing] >= 0).any():
        standing = standing[standing]
    return standing
