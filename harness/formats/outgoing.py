"""A domain as the model files can say it: what is checked, merged and lost on the way out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from harness.errors import HarnessError
from harness.model.domain import Domain

Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Arrows:
    """Ways that steps can go, at most one from each source to each target, in ascending order."""

    source: Ints
    target: Ints
    probability: NDArray[np.float64]
    reward: NDArray[np.float64]
    reading: Ints

    @property
    def begins(self) -> Ints:
        """Where each source's begin; all sources have some."""
        return np.flatnonzero(np.diff(self.source, prepend=-1))

    def same_reward(self) -> NDArray[np.bool_]:
        """(arrows,) whether all arrows of the same source pay the same."""
        first = self.begins
        alike = np.minimum.reduceat(self.reward, first) == np.maximum.reduceat(self.reward, first)
        return np.repeat(alike, np.diff(np.append(first, len(self.source))))


def arrows(
    name: str, source: Ints, target: Ints, probability: NDArray[np.float64], reward: NDArray[np.float64], reading: Ints
) -> Arrows:
    """Arrows of outcomes; those from and to the same become one, which pays what is expected.

    Raises:
        HarnessError: they differ in what is read, which belongs to the target in both formats.
    """
    order = np.lexsort((target, source))
    source, target, probability = source[order], target[order], probability[order]
    reward, reading = reward[order], reading[order]
    new = (np.diff(source, prepend=-1) != 0) | (np.diff(target, prepend=-1) != 0)
    if new.all():
        return Arrows(source, target, probability, reward, reading)
    if (reading != reading[new][np.cumsum(new) - 1]).any():
        raise HarnessError(f"{name}: two ways from a state to another differ in what is read; keep it as a snapshot")
    first = np.flatnonzero(new)
    total = np.add.reduceat(probability, first)
    low, high = np.minimum.reduceat(reward, first), np.maximum.reduceat(reward, first)
    paid = np.where(low == high, low, np.add.reduceat(probability * reward, first) / total)
    return Arrows(source[new], target[new], total, paid, reading[new])


def row_choices(domain: Domain) -> tuple[Ints, Ints]:
    """(rows,) of which visible value and action each row is, and at which value of the factor that they touch."""
    first, sizes = domain.arrays["first_row"].astype(np.int64), np.array([*domain.factor_sizes, 1])
    size = np.where(first >= 0, sizes[domain.arrays["factor"]], 0)
    choice, value = (
        np.repeat(np.arange(len(first)), size),
        np.arange(size.sum()) - np.repeat(np.cumsum(size) - size, size),
    )
    row = np.repeat(first, size) + value
    order = np.argsort(row)
    if not np.array_equal(row[order], np.arange(len(domain.arrays["legal"]))):
        raise HarnessError(f"{domain.name}: rows of its tables are shared by several choices, or unused")
    return choice[order], value[order]


def is_flat(domain: Domain) -> bool:
    """Whether the whole state is one hidden factor, and the end is nothing but some of its values."""
    t = domain.arrays
    live = np.flatnonzero(~t["terminal"])
    if len(domain.factors) != 1 or len(live) != 1 or len(t["legal"]) != domain.n_actions * domain.factor_sizes[0]:
        return False
    row = np.repeat(np.arange(len(t["legal"])), np.diff(t["row_outcomes"]))
    over = t["terminal"][t["outcome_visible"]]
    reward = t["outcome_reward"][domain.shapings.index(domain.shaping)]
    value = row_choices(domain)[1]
    goes_on = np.unique(value[row[~over | (reward != 0)]])
    ends = np.append(t["outcome_value"][over], t["start_values"][t["terminal"][t["start_visible"]], 0])
    return not np.isin(ends, goes_on).any()


def check(domain: Domain) -> None:
    """Refuse what no model file can say.

    Raises:
        HarnessError: something is read before the first step that tells of what is hidden.
    """
    if ((domain.arrays["prior_factor"] >= 0) & (domain.arrays["prior_observation"] >= 0).any(axis=1)).any():
        raise HarnessError(
            f"{domain.name}: something is read before the first step, which tells of what is hidden; model files "
            "cannot say that; keep it as a snapshot (.npz)"
        )


def losses(domain: Domain) -> list[str]:
    """What of a domain is not in a model file of it."""
    lost = []
    if (domain.arrays["start_observation"] >= 0).any():
        lost.append("the reading before the first step, which tells nothing")
    if not domain.arrays["legal"].all():
        lost.append("which actions are legal (all are, in a model file)")
    if len(domain.shapings) > 1:
        lost.append(f"the rewards but '{domain.shaping}'")
    if domain.layout.get("kind") != "none":
        lost.append("the layout that pictures are drawn of")
    return lost
