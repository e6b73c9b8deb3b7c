"""All hidden factors as one, for what knows no sensors: solving point by point, model files, chains.

Sensors that read several factors after one step do not fit where a step tells of one factor at most. Over the joint
value of all factors (H of them, the last factor varying fastest) the same model is one where it does: its observation
hangs on that value, and nothing else is different.
"""

from __future__ import annotations

import functools
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.errors import HarnessError
from harness.model.domain import Domain
from harness.model.indexing import spans, strides

_MOST_VALUES = 2**15 - 1  # the tables count them in 16 bits
_MOST_NUMBERS = 2**26  # in the outcomes, and in the distributions of the observation: half a gigabyte each

Ints = NDArray[np.int64]


@functools.lru_cache(maxsize=2)
def joined(domain: Domain) -> Domain:
    """The domain with one hidden factor and without sensors; itself where it has none.

    Visible values, actions and observations keep their indices, and joint values are those of
    :meth:`harness.engine.batch.Batch.joint`. Features and layout, which are of the factors, are left out.

    Raises:
        HarnessError: it is too large.
    """
    if not domain.sensors:
        return domain
    _check(domain)
    return replace(
        domain,
        factors=(", ".join(domain.factors),),
        factor_labels=(tuple(", ".join(labels) for labels in _labels(domain)),),
        features=(),
        layout={"kind": "none"},
        arrays={**_steps(domain), **_start(domain), "visible_values": domain.visible_values},
        sensors=(),
        live=None,
    )


def _check(domain: Domain) -> None:
    live = int((domain.arrays["first_row"] >= 0).sum())
    numbers = max(live, domain.n_visible * domain.n_observations) * domain.n_joint
    if domain.n_joint > _MOST_VALUES or numbers > _MOST_NUMBERS:
        raise HarnessError(
            f"{domain.name}: {domain.n_joint:,} joint values of what is hidden and {domain.n_observations:,} "
            "observations are too many to have its factors as one, which is needed as sensors read several at once"
        )


def _labels(domain: Domain) -> list[list[str]]:
    values = _values(domain)
    return [[labels[x] for labels, x in zip(domain.factor_labels, row, strict=True)] for row in values.tolist()]


def _values(domain: Domain) -> Ints:
    """(H, K) value of each factor at each joint value."""
    sizes = np.array(domain.factor_sizes, dtype=np.int64)
    return np.arange(domain.n_joint)[:, None] // strides(sizes) % sizes


class JointSteps(NamedTuple):
    """The steps from every choice (visible value, action) and joint value of what is hidden."""

    choice: Ints
    """(n,) choices that are not terminal, each once for every joint value"""
    hidden: Ints
    """(n,) that joint value"""
    row: Ints
    """(n,) their rows"""
    outcome: Ints
    """(m,) the outcomes of these rows"""
    of: Ints
    """(m,) which of the n each belongs to"""
    after: Ints
    """(m,) the joint value that it leads to"""


def joint_steps(domain: Domain) -> JointSteps:
    """Its steps over the joint values of all its factors (the last one varying fastest)."""
    t, joint = domain.arrays, domain.n_joint
    live = np.flatnonzero(t["first_row"] >= 0)
    choice, hidden = np.repeat(live, joint), np.tile(np.arange(joint), len(live))
    k = t["factor"][choice]  # −1, none, takes the last of these: a factor of one value
    stride, size = np.append(strides(domain.factor_sizes), 1)[k], np.array([*domain.factor_sizes, 1])[k]
    value = hidden // stride % size
    row = t["first_row"][choice] + value
    begins = t["row_outcomes"].astype(np.int64)
    outcome, of = spans(begins[row], begins[row + 1] - begins[row])
    moved = np.where(k[of] >= 0, (t["outcome_value"][outcome] - value[of]) * stride[of], 0)
    return JointSteps(choice, hidden, row, outcome, of, hidden[of] + moved)


def _steps(domain: Domain) -> dict[str, NDArray[Any]]:
    t, joint = domain.arrays, domain.n_joint
    choice, _, row, outcome, of, after = joint_steps(domain)
    next_choice = t["outcome_visible"][outcome].astype(np.int64) * domain.n_actions + choice[of] % domain.n_actions
    reading, readings = _readings(domain, t["outcome_observation"][outcome], next_choice, after)
    first_row = np.full(len(t["first_row"]), -1)
    first_row[choice[::joint]] = np.arange(0, len(choice), joint)
    copied = ("visible", "probability", "cdf")
    return _typed({
        "first_row": first_row, "factor": np.where(first_row >= 0, 0, -1), "terminal": t["terminal"],
        "legal": t["legal"][row], "row_outcomes": np.searchsorted(of, np.arange(len(row) + 1)),
        **{f"outcome_{name}": t[f"outcome_{name}"][outcome] for name in copied}, "outcome_value": after,
        "outcome_observation": reading, "outcome_reward": t["outcome_reward"][:, outcome],
        "observation_probability": readings, "observation_cdf": np.cumsum(readings, axis=1),
    }, domain)  # fmt: skip


def _readings(domain: Domain, own: NDArray[Any], choice: Ints, hidden: Ints) -> tuple[Ints, NDArray[np.float64]]:
    """Of outcomes: number of the distribution of the whole observation, and these distributions (…, O).

    ``own`` is the distribution of the step's own observation, ``choice`` the next visible value with the action,
    ``hidden`` the next joint value.
    """
    t = domain.arrays
    different, place = np.unique(t["sensor_row"], axis=0, return_inverse=True)
    case = np.stack([own.astype(np.int64), place.reshape(-1)[choice], hidden], axis=1)
    cases, number = np.unique(case, axis=0, return_inverse=True)
    table = t["observation_probability"][cases[:, 0]]
    values = _values(domain)[cases[:, 2]]
    for j, sensor in enumerate(domain.sensors):
        row, silent = different[cases[:, 1], j].astype(np.int64), np.eye(1, len(sensor.labels))
        read = t["sensor_probability"][np.where(row < 0, 0, row + values[:, sensor.factor]), : len(sensor.labels)]
        read = np.where(row[:, None] < 0, silent, read)
        table = (table[:, :, None] * read[:, None]).reshape(len(table), -1)
    return number.reshape(-1), table


def _start(domain: Domain) -> dict[str, NDArray[Any]]:
    """Nothing is read before the first step where there are sensors."""
    t, values = domain.arrays, _values(domain)
    prior = np.ones((len(t["prior_visible"]), domain.n_joint))
    for k, first in enumerate(domain.factor_offset[:-1]):
        prior *= t["prior_marginals"][:, first + values[:, k]]
    kept = ("start_visible", "start_cdf", "start_observation", "prior_visible")
    return _typed({
        **{name: t[name] for name in kept},
        "start_values": t["start_values"].astype(np.int64) @ strides(domain.factor_sizes)[:, None],
        "prior_marginals": prior, "prior_factor": np.full(len(prior), -1),
        "prior_observation": np.full(prior.shape, -1),
    }, domain)  # fmt: skip


def _typed(arrays: dict[str, NDArray[Any]], like: Domain) -> dict[str, NDArray[Any]]:
    """In the types that the domain's own arrays have."""
    return {name: np.ascontiguousarray(array, dtype=like.arrays[name].dtype) for name, array in arrays.items()}
