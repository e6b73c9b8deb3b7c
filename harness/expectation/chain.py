"""The discounted return of a controller without a horizon: a linear system over its Markov chain."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import linalg

from harness import host
from harness.errors import HarnessError
from harness.model.domain import Domain
from harness.model.indexing import spans, strides
from harness.model.joining import joined
from harness.model.tables import STOP
from harness.policy.fsc import FileController


class Endless(NamedTuple):
    """The expected discounted return of a controller, without a horizon."""

    value: float
    error: float
    """Bound of what the solution of the linear system may be off by: its residual over 1 − γ."""
    states: int
    """Of the chain: (node, visible value, reading, hidden values) that can be reached."""


def endless(domain: Domain, controller: FileController) -> Endless:
    """Solve v = r + γ P v over what the controller can reach (Hansen 1998, policy evaluation).

    Raises:
        HarnessError: the domain's discount is not below 1.
    """
    if not domain.discount < 1:
        raise HarnessError(f"{domain.name} has discount {domain.discount}: without a horizon its returns have no bound")
    chain = _Chain(joined(domain), controller)
    known, mass = chain.start()
    frontier, edges, rewards = known, [], np.zeros(0)
    order = np.zeros(0, dtype=np.int64)
    while len(frontier):
        reward, source, target, chance = chain.step(frontier)
        order, rewards = np.append(order, frontier), np.append(rewards, reward)
        edges.append((frontier[source], target, chance))
        host.check_memory("the chain of the controller", 200.0 * sum(len(each[2]) for each in edges))
        frontier = np.setdiff1d(target, known)
        known = np.union1d(known, frontier)
    sources, targets, chances = (np.concatenate(parts) for parts in zip(*edges, strict=True))
    n, rank = len(known), np.searchsorted(known, order)
    r = np.zeros(n)
    r[rank] = rewards
    moves = (np.searchsorted(known, sources), np.searchsorted(known, targets))
    system = sparse.eye(n, format="csc") - domain.discount * sparse.csc_matrix((chances, moves), shape=(n, n))
    v = linalg.spsolve(system, r)
    error = float(np.abs(r - system @ v).max() / (1 - domain.discount))
    return Endless(float(mass @ v[np.searchsorted(known, chain.start()[0])]), error, n)


class _Chain:
    """States are numbers: ((node · V + visible) · (O + 1) + reading + 1) · H + joint hidden value."""

    def __init__(self, domain: Domain, controller: FileController) -> None:
        self.domain, self.nodes, self.t = domain, controller.nodes, domain.tables
        self.shape = (*controller.nodes.action.shape, domain.n_joint)
        self.strides = strides(domain.factor_sizes)

    def start(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """States before the first step that have not ended, and their probabilities."""
        t = self.t
        joint = t.start_values.astype(np.int64) @ self.strides if len(self.strides) else np.zeros(len(t.start_cdf), int)
        chance = np.diff(t.start_cdf, prepend=0.0)
        readings = np.vstack([np.pad(t.reading_probability, ((0, 0), (1, 0))), np.eye(1, self.shape[2])])  # last: none
        i, reading = np.nonzero(readings[t.start_reading])
        keep = ~t.terminal[t.start_visible[i]]
        i, reading = i[keep], reading[keep]
        node = np.full(len(i), self.nodes.start)
        state = np.ravel_multi_index((node, t.start_visible[i], reading, joint[i]), self.shape)
        known, place = np.unique(state.astype(np.int64), return_inverse=True)
        return known, np.bincount(place, chance[i] * readings[t.start_reading][i, reading]).astype(np.float64)

    def step(
        self, states: NDArray[np.int64]
    ) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
        """Expected rewards of the states, and the moves out of them: from which place, to which state, how likely."""
        t, outcomes = self.t, self.t.outcomes
        node, visible, reading, joint = np.unravel_index(states, self.shape)
        action = self.nodes.action[node, visible, reading]
        choice = t.choices[visible * t.n_actions + np.maximum(action, 0)]
        factor = choice["factor"].astype(np.int64)
        sizes, stride = np.append(self.domain.factor_sizes, 1).astype(np.int64), np.append(self.strides, 0)
        value = joint // np.maximum(stride[factor], 1) % sizes[factor]  # 0 without a factor
        row = t.rows[choice["first_row"] + value]
        count = np.where(action == STOP, 0, row["last"] - row["first"])
        j, source = spans(row["first"], count)
        paid = np.zeros(len(states))
        np.add.at(paid, source, outcomes["probability"][j] * outcomes["reward"][j])
        goes_on = ~outcomes["ends"][j]
        j, source = j[goes_on], source[goes_on]
        k, o = np.nonzero(t.reading_probability[outcomes["reading"][j]])
        j, source = j[k], source[k]
        after = joint[source] + (outcomes["value"][j] - value[source]) * stride[factor[source]]
        following = self.nodes.next[node, visible, reading][source]
        target = np.ravel_multi_index((following, outcomes["visible"][j], o + 1, after), self.shape).astype(np.int64)
        chance = outcomes["probability"][j] * t.reading_probability[outcomes["reading"][j], o]
        return paid, source, target, chance
