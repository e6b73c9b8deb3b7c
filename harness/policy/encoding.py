"""What an agent that learns is shown of an episode: a vector of numbers from 0 to 1.

The environments of :mod:`harness.gym` and the policies of :mod:`harness.policy.agent` share it, so that an agent plays
on exactly what it was trained on.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.engine.batch import Batch
from harness.errors import HarnessError, nearest, quoted
from harness.model.domain import Domain
from harness.model.tables import compiled

KINDS = ("reading", "action-reading", "belief", "marginals")
"""What an encoding may hold, besides the visible part."""


def check_kind(kind: str) -> None:
    """Check that ``kind`` is one of :data:`KINDS`.

    Raises:
        HarnessError: it is none.
    """
    if kind not in KINDS:
        raise HarnessError(f"no observation {quoted(kind)}{nearest(kind, KINDS)} (known: {', '.join(KINDS)})")


def shows_belief(kind: str) -> bool:
    """Whether the belief is in it."""
    return kind in ("belief", "marginals")


class Encoding:
    """Episodes as vectors of D float32 numbers in [0, 1].

    In order: for ``action-reading`` the last action, one-hot (A numbers, all 0 before the first); for it and
    ``reading`` the last observation, one-hot (O numbers, all 0 where there is none yet; where sensors read unasked, the
    label of each is one-hot by itself); for ``belief`` the domain's F belief features; for ``marginals`` the N
    probabilities of all values of the hidden factors. Then for every kind the visible part, each of its numbers one-hot
    over the values that it takes in the domain: what pays in one place pays nothing beside it, and a network need not
    learn first to tell places apart.
    """

    def __init__(self, kind: str, domain: Domain) -> None:
        """``kind``: one of :data:`KINDS`.

        Raises:
            HarnessError: there is no such kind.
        """
        check_kind(kind)
        self.kind, self.domain = kind, domain
        self._actions = domain.n_actions if kind == "action-reading" else 0
        self._readings = _readings(domain, not shows_belief(kind))
        self._columns = _columns(kind, domain)
        self._visible = _one_hot(domain.visible_values)

    @property
    def names(self) -> tuple[str, ...]:
        """(D,) what each number is."""
        domain = self.domain
        return (
            *(f"did {action}" for action in domain.actions[: self._actions]),
            *self._readings.names,
            *_belief_names(self.kind, domain),
            *_visible_names(domain),
        )

    @property
    def size(self) -> int:
        """Number D."""
        return self._actions + len(self._readings.names) + len(self._columns) + self._visible.shape[1]

    def __call__(self, batch: Batch, last: NDArray[np.int32]) -> NDArray[np.float32]:
        """(E, D) of a batch, a new array; ``last`` (E,): the last actions, −1 before the first.

        Raises:
            PolicyError: the belief is to be shown, and the engine left it out.
        """
        marginals = batch.tracked() if shows_belief(self.kind) else batch.marginals
        out = np.empty((batch.size, self.size), dtype=np.float32)
        _encode(
            last,
            self._actions,
            batch.observation,
            self._readings.place,
            len(self._readings.names),
            marginals,
            self._columns,
            batch.visible,
            self._visible,
            out,
        )
        return out


class _Readings(NamedTuple):
    """How observations are shown: R numbers, of which some are 1."""

    names: list[str]
    """(R,)"""
    place: NDArray[np.int64]
    """(O, …) which are 1"""


def _readings(domain: Domain, shown: bool) -> _Readings:
    if not shown:
        return _Readings([], np.zeros((domain.n_observations, 0), dtype=np.int64))
    every, own = np.arange(domain.n_observations), domain.n_observations // domain.n_labels
    if not domain.sensors:
        return _Readings([f"read {each}" for each in domain.observations], every[:, None])
    parts = [sensor.labels for sensor in domain.sensors]
    names = [f"{sensor.name} read {label}" for sensor in domain.sensors for label in sensor.labels]
    place = domain.labels_of(every) + np.cumsum([0, *map(len, parts)])[:-1]
    if own == 1:
        return _Readings(names, place)
    return _Readings(
        [*names, *(f"read {i}" for i in range(own))], np.column_stack([place, len(names) + every // domain.n_labels])
    )


def _columns(kind: str, domain: Domain) -> NDArray[np.int64]:
    """Columns of the marginals that are shown."""
    if kind == "marginals":
        return np.arange(domain.n_marginals)
    return domain.feature_columns if kind == "belief" else np.arange(0)


def _belief_names(kind: str, domain: Domain) -> list[str]:
    if kind == "marginals":
        labelled = zip(domain.factors, domain.factor_labels, strict=True)
        return [f"{factor} = {label}" for factor, labels in labelled for label in labels]
    return [name for name, _, _ in domain.features] if kind == "belief" else []


def _visible_names(domain: Domain) -> list[str]:
    columns = zip(domain.visible_names, domain.visible_values.T, strict=True)
    return [f"{name} = {value}" for name, column in columns for value in np.unique(column)]


def _one_hot(values: NDArray[np.int16]) -> NDArray[np.float32]:
    """(V, D) what is shown of each visible value."""
    shown = [column[:, None] == np.unique(column) for column in values.T]
    return np.hstack([np.empty((len(values), 0)), *shown]).astype(np.float32)


@compiled
def _encode(
    last: NDArray[np.int32],
    n_actions: int,
    observation: NDArray[np.int32],
    place: NDArray[np.int64],
    n_readings: int,
    marginals: NDArray[np.float64],
    columns: NDArray[np.int64],
    visible: NDArray[np.int32],
    shown: NDArray[np.float32],
    out: NDArray[np.float32],
) -> None:
    for e in range(len(visible)):
        for i in range(n_actions + n_readings):
            out[e, i] = 0.0
        if n_actions > 0 and last[e] >= 0:
            out[e, last[e]] = 1.0
        if n_readings > 0 and observation[e] >= 0:
            for j in range(place.shape[1]):
                out[e, n_actions + place[observation[e], j]] = 1.0
        at = n_actions + n_readings
        for i in range(len(columns)):
            out[e, at + i] = marginals[e, columns[i]]
        at += len(columns)
        for i in range(shown.shape[1]):
            out[e, at + i] = shown[visible[e], i]
