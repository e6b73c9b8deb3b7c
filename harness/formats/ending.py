"""Where episodes end: no model file says it, but states from which nothing is ever paid again are the end.

To tell the agent that one of them has been reached changes nothing that it can earn: what it does after the end is not
paid, so it loses nothing if it acts as if the end had not come.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import breadth_first_order

from harness.formats import limits
from harness.formats.starting import Start

Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Outcomes:
    """The rows of a domain's tables and their outcomes."""

    terminal: NDArray[np.bool_]
    """(V,)"""
    factor: Ints
    """(V·A,) of each pair of a visible value and an action; −1 for none."""
    pair: Ints
    """(rows,) which pair a row belongs to."""
    row: Ints
    """(outcomes,) which row an outcome belongs to; the rest (outcomes,) too."""
    visible: Ints
    value: Ints
    probability: NDArray[np.float64]
    reading: Ints
    reward: NDArray[np.float64]
    readings: NDArray[np.float64]
    """(distributions, O)"""

    @property
    def n_actions(self) -> int:
        """Number A of actions."""
        return len(self.factor) // len(self.terminal)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The arrays of a domain that tell of steps."""
        count = np.bincount(self.row, minlength=len(self.pair))
        first_row = np.full(len(self.factor), -1, dtype=np.int64)
        pairs, first = np.unique(self.pair, return_index=True)
        first_row[pairs] = first
        return {
            "first_row": first_row, "factor": self.factor, "terminal": self.terminal,
            "legal": np.ones(len(self.pair), dtype=np.bool_),
            "row_outcomes": np.concatenate([[0], np.cumsum(count)]),
            "outcome_visible": self.visible, "outcome_value": self.value, "outcome_probability": self.probability,
            "outcome_cdf": running(self.probability, count), "outcome_observation": self.reading,
            "outcome_reward": self.reward[None], "observation_probability": self.readings,
            "observation_cdf": np.cumsum(self.readings, axis=1),
        }  # fmt: skip


def running(numbers: NDArray[np.float64], count: Ints) -> NDArray[np.float64]:
    """Running sums of consecutive spans, each added up from its beginning, so that rounding is that of a plain loop."""
    sums, first = numbers.copy(), np.cumsum(count) - count
    for i in range(1, int(count.max(initial=0))):
        place = first[count > i] + i
        sums[place] += sums[place - 1]
    return sums


def ended(sizes: Sequence[int], steps: Outcomes, start: Start, *, always: bool) -> tuple[Outcomes, Start]:
    """The steps with the visible values that are terminal, and the start.

    Where one hidden factor is all that is hidden, its values too can be the end: what leads there leads to one more
    visible value, which is there ``always`` where nothing else is visible.
    """
    live, last = _live(steps, sizes[0] if len(sizes) == 1 else 1), len(steps.terminal)
    if not live.any():  # nothing is ever paid: a model like any other
        live = np.ones_like(live)
    terminal = np.logical_not(live.any(axis=1))
    partly = ~live & ~terminal[:, None]
    over = partly[steps.visible, steps.value if partly.shape[1] > 1 else 0]
    begin = _moved(start, partly, last)
    more = always or over.any() or (begin.visible == last).any()
    terminal = np.append(terminal, np.ones(1 if more else 0, dtype=np.bool_))
    factor = np.append(steps.factor, np.full((len(terminal) - last) * steps.n_actions, -1))
    visible = np.where(over, last, steps.visible)
    return _compact(replace(steps, terminal=terminal, factor=factor, visible=visible)), begin


def _live(steps: Outcomes, size: int) -> NDArray[np.bool_]:
    """(V, size) from where something may still be paid; size is 1 where values of the hidden part do not count.

    Found backwards from the rows that pay.
    """
    single = size > 1 and len(steps.factor) * size <= limits.LARGEST_ROWS
    size = size if single else 1
    at = steps.pair[steps.row] // steps.n_actions * size
    to = steps.visible * size
    one = single & (steps.factor[steps.pair[steps.row]] >= 0)  # whether an outcome is of one hidden value
    value = np.arange(len(steps.pair)) - np.searchsorted(steps.pair, steps.pair)
    shared, hidden = np.repeat(np.flatnonzero(~one), size), np.tile(np.arange(size), int((~one).sum()))
    source = np.concatenate([at[one] + value[steps.row[one]], at[shared] + hidden])
    target = np.concatenate([to[one] + steps.value[one], to[shared] + hidden])
    pays = np.unique(source[np.concatenate([steps.reward[one], steps.reward[shared]]) != 0])
    n = len(steps.terminal) * size
    edges = np.concatenate([target, np.full(len(pays), n)]), np.concatenate([source, pays])
    graph = csr_matrix((np.ones(len(edges[0]), dtype=np.int8), edges), shape=(n + 1, n + 1))
    live = np.zeros(n + 1, dtype=np.bool_)
    live[breadth_first_order(graph, n, return_predecessors=False)] = True
    return live[:n].reshape(-1, size)


def _moved(start: Start, partly: NDArray[np.bool_], last: int) -> Start:
    """The start, of which what begins at the end begins in the visible value ``last``."""
    if not partly[start.prior_visible].any():
        return start
    over = partly[start.visible, start.values[:, 0]]
    visible = np.where(over, last, start.visible)
    known = np.unique(visible)
    prior = np.zeros((len(known), start.prior.shape[1]))
    np.add.at(prior, (np.searchsorted(known, visible), start.values[:, 0]), start.probability)
    return replace(start, visible=visible, prior_visible=known, prior=prior / prior.sum(axis=1, keepdims=True))


def _compact(steps: Outcomes) -> Outcomes:
    """Without the rows of terminal values, and the distributions of readings numbered as they are first met."""
    kept = ~steps.terminal[steps.pair // steps.n_actions]
    factor = np.where(np.repeat(steps.terminal, steps.n_actions), -1, steps.factor)
    outcome, number = kept[steps.row], np.cumsum(kept) - 1
    used, first, met = np.unique(steps.reading[outcome], return_index=True, return_inverse=True)
    order = np.argsort(first)
    return replace(
        steps, factor=factor, pair=steps.pair[kept], row=number[steps.row[outcome]], visible=steps.visible[outcome],
        value=steps.value[outcome], probability=steps.probability[outcome], reward=steps.reward[outcome],
        reading=np.argsort(order)[met.reshape(-1)], readings=steps.readings[used[order]],
    )  # fmt: skip
