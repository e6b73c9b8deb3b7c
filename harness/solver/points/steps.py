"""What may follow an action over the joint hidden value: sparse, row by row.

A joint hidden value h is one value of every factor (H of them, the last factor varying fastest); in a model that is
one factor it is that factor's value. A choice, visible value v and action a, touches one factor at most: its *row* for
that factor's value lists the entries (branch, how h changes, probability), where a *branch* is a next visible value
with a reading. What ends the episode has no entry: nothing is earned after it.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.model.domain import Domain
from harness.model.indexing import spans, strides
from harness.model.joining import joined
from harness.model.tables import Records, Tables


class Steps(NamedTuple):
    """A domain by rows. V visible values, A actions, H joint hidden values."""

    discount: float
    n_visible: int
    n_actions: int
    n_hidden: int
    stride: NDArray[np.int64]
    """(V·A,) of the factor that a choice touches: its value at h is ``h // stride % size``."""
    size: NDArray[np.int64]
    """(V·A,) of that factor; 1 where the choice touches none; 0 at a terminal visible value, which has no choices."""
    first_row: NDArray[np.int64]
    """(V·A + 1,) rows of a choice, one a value of its factor, begin here."""
    reward: NDArray[np.float64]
    """(rows,) expected reward"""
    first_entry: NDArray[np.int64]
    """(rows + 1,)"""
    branch: NDArray[np.int32]
    """(entries,) number of the branch within its choice, rising within a row"""
    shift: NDArray[np.int64]
    """(entries,) next h less the present one"""
    probability: NDArray[np.float64]
    """(entries,) above 0"""
    first_branch: NDArray[np.int64]
    """(V·A + 1,)"""
    branch_visible: NDArray[np.int32]
    """(branches,) next visible value; never a terminal one"""
    unsure: float
    """How far the probabilities of a row are from 1 in sum, at most: tables are rounded, too"""

    @property
    def span(self) -> float:
        """No policy's value is further from 0, whatever is hidden."""
        return float(np.abs(self.reward).max(initial=0.0) / (1.0 - self.discount))

    @property
    def terms(self) -> int:
        """Entries of the longest row."""
        return int(np.diff(self.first_entry).max(initial=0))


class _Rows(NamedTuple):
    """The rows of all choices, one after the other (choices may share some in the tables, not here)."""

    size: NDArray[np.int64]
    """(V·A,) as in :class:`Steps`"""
    choice: NDArray[np.int64]
    """(rows,)"""
    value: NDArray[np.int64]
    """(rows,) of the choice's factor"""
    first: NDArray[np.int64]
    """(rows,) outcomes of the tables begin here"""
    outcomes: NDArray[np.int64]
    """(rows,) and are so many"""


def entries_of(domain: Domain) -> int:
    """How many entries :func:`steps_of` makes at most."""
    domain = joined(domain)
    rows, t = _rows_of(domain), domain.tables
    readings = (t.reading_probability > 0).sum(axis=1)[t.outcomes["reading"]]
    before = np.concatenate([[0], np.cumsum(readings)])
    return int((before[rows.first + rows.outcomes] - before[rows.first]).sum())


def steps_of(domain: Domain) -> Steps:
    """The rows of a domain under its true reward."""
    domain = joined(domain.shaped("none"))
    rows, t = _rows_of(domain), domain.tables
    place, row = spans(rows.first, rows.outcomes)
    reward = np.zeros(len(rows.choice))
    np.add.at(reward, row, t.outcomes["probability"][place] * t.outcomes["reward"][place])
    goes_on = ~t.outcomes["ends"][place]
    row, reading, outcome = _readings(t, row[goes_on], t.outcomes[place[goes_on]])
    probability = outcome["probability"] * t.reading_probability[outcome["reading"], reading]
    choice, stride = rows.choice[row], _strides(domain)[t.choices["factor"]]
    ways = domain.n_visible * domain.n_observations
    found, branch = np.unique(
        choice * ways + outcome["visible"].astype(np.int64) * domain.n_observations + reading, return_inverse=True
    )
    first_branch = np.searchsorted(found, np.arange(len(stride) + 1) * ways)
    moved = np.where(t.choices["factor"][choice] >= 0, outcome["value"] - rows.value[row], 0)
    order = np.lexsort((moved, branch, row))
    return Steps(
        float(domain.discount),
        domain.n_visible,
        domain.n_actions,
        domain.n_joint,
        stride,
        rows.size,
        _begins(rows.size),
        reward,
        _begins(np.bincount(row, minlength=len(rows.choice))),
        (branch - first_branch[choice])[order].astype(np.int32),
        (moved * stride[choice])[order],
        probability[order],
        first_branch,
        (found % ways // domain.n_observations).astype(np.int32),
        _unsure(t),
    )


def _unsure(t: Tables) -> float:
    outcomes = np.add.reduceat(t.outcomes["probability"], t.rows["first"])
    readings = t.reading_probability.sum(axis=1)
    return float(np.abs(outcomes - 1.0).max() + np.abs(readings - 1.0).max())


def _rows_of(domain: Domain) -> _Rows:
    t = domain.tables
    begins, k = t.choices["first_row"].astype(np.int64), t.choices["factor"]
    size = np.where(begins >= 0, np.array([*domain.factor_sizes, 1])[k], 0)
    row, choice = spans(begins, size)
    return _Rows(size, choice, row - begins[choice], t.rows["first"][row], (t.rows["last"] - t.rows["first"])[row])


def _strides(domain: Domain) -> NDArray[np.int64]:
    """(K + 1,) of every factor; the last entry serves factor −1."""
    return np.append(strides(domain.factor_sizes), 1)


def _readings(
    t: Tables, row: NDArray[np.int64], outcome: Records
) -> tuple[NDArray[np.int64], NDArray[np.int64], Records]:
    """Rows and outcomes, each as often as there are readings that may follow, and these readings."""
    distribution, reading = np.nonzero(t.reading_probability > 0)
    count = np.bincount(distribution, minlength=len(t.reading_probability))
    place, which = spans(_begins(count)[outcome["reading"]], count[outcome["reading"]])
    return row[which], reading[place], outcome[which]


def _begins(count: NDArray[np.int64]) -> NDArray[np.int64]:
    """Where each of several spans begins, and where the last one ends."""
    return np.concatenate([[0], np.cumsum(count)]).astype(np.int64)


class Start(NamedTuple):
    """One way that an episode can begin, as the agent sees it."""

    share: float
    """Its probability"""
    visible: int
    belief: NDArray[np.float64]
    """(H,)"""


def starts(domain: Domain) -> list[Start]:
    """All ways to begin: visible values, split by the first reading where that tells of what is hidden."""
    domain = joined(domain)
    t = domain.arrays
    weight = np.diff(t["start_cdf"], prepend=0.0)
    ways = []
    for i, v in enumerate(t["prior_visible"]):
        here = t["start_visible"] == v
        belief = _joint(domain, t["prior_marginals"][i])
        for share, posterior in _split(domain, i, belief, bool((t["start_observation"][here] >= 0).any())):
            ways.append(Start(float(weight[here].sum() * share), int(v), posterior))
    return ways


def _joint(domain: Domain, marginals: NDArray[np.float64]) -> NDArray[np.float64]:
    """(H,) product of the factors' distributions."""
    joint = np.ones(1)
    for first, last in itertools.pairwise(domain.factor_offset):
        joint = np.outer(joint, marginals[first:last]).ravel()
    return joint


def _split(
    domain: Domain, prior: int, belief: NDArray[np.float64], read: bool
) -> Iterator[tuple[float, NDArray[np.float64]]]:
    """Probability and posterior (H,) of every first reading; the prior itself where there is none that tells."""
    t, k = domain.arrays, int(domain.arrays["prior_factor"][prior])
    if k < 0 or not read:
        yield 1.0, belief
        return
    value = np.arange(domain.n_joint) // _strides(domain)[k] % domain.factor_sizes[k]
    likelihood = t["observation_probability"][t["prior_observation"][prior]][value]
    for o in range(domain.n_observations):
        seen = belief * likelihood[:, o]
        if seen.sum() > 0:
            yield float(seen.sum()), seen / seen.sum()
