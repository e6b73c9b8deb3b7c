"""A domain: names, sizes, layout and tables of a POMDP.

A :class:`Domain` is read from a snapshot (an archive exported by ``harness export``) or a model file, or made from live
Julia or of plain arrays; either way it holds the same arrays, and no line of Python says how the domain behaves.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness import cards
from harness.errors import HarnessError, SnapshotError, nearest, quoted
from harness.model import archive, validation
from harness.model.certainty import sure
from harness.model.indexing import strides
from harness.model.tables import Records, Tables, from_arrays

KIND = "domain"

ARRAYS: dict[str, Any] = {  # what Julia exports, and the types that the compiled code takes
    "first_row": np.int32,
    "factor": np.int16,
    "terminal": np.bool_,
    "legal": np.bool_,
    "row_outcomes": np.int32,
    "outcome_visible": np.int32,
    "outcome_value": np.int16,
    "outcome_probability": np.float64,
    "outcome_cdf": np.float64,
    "outcome_observation": np.int32,
    "outcome_reward": np.float64,
    "observation_probability": np.float64,
    "observation_cdf": np.float64,
    "start_visible": np.int32,
    "start_values": np.int16,
    "start_cdf": np.float64,
    "start_observation": np.int32,
    "prior_visible": np.int32,
    "prior_marginals": np.float64,
    "prior_factor": np.int16,
    "prior_observation": np.int32,
    "visible_values": np.int16,
}
SENSOR_ARRAYS: dict[str, Any] = {"sensor_row": np.int32, "sensor_probability": np.float64, "sensor_cdf": np.float64}
"""What is there besides where something is read unasked."""


class Sensor(NamedTuple):
    """Something that reads one hidden factor after every step, whatever the action was."""

    name: str
    """As programs spell it: ``3`` in ``3 == "good"``."""
    factor: int
    labels: tuple[str, ...]
    """Names of what it may read, in index order."""


class Agent(NamedTuple):
    """One of several who act at once, each by its own readings alone (a Dec-POMDP: Bernstein et al., UAI 2000)."""

    name: str
    actions: tuple[str, ...]
    """Its own actions as programs spell them, in index order."""
    observations: tuple[str, ...]
    """Names of what it may observe, in index order."""


def types(sensors: Sequence[Any]) -> dict[str, Any]:
    """The arrays of a domain with these sensors, and their types."""
    return ARRAYS | (SENSOR_ARRAYS if sensors else {})


@dataclass(frozen=True, eq=False)
class Domain:
    """A POMDP as the harness sees it.

    A state splits into a *visible* part, which the agent always knows, and K hidden *factors*, which are independent
    given the visible part. ``features`` are what policies may ask of the belief: ``belief(3)`` is the probability
    that factor 2 has a certain value.
    """

    name: str
    version: int
    """Rises whenever scores on the domain could change; table rows carry it."""
    title: str
    discount: float
    n_states: int
    actions: tuple[str, ...]
    """Action names as programs spell them, in index order."""
    observations: tuple[str, ...]
    """Names of what may be observed after a step; where there are sensors, of all combinations with their labels."""
    visible_names: tuple[str, ...]
    """Names of the numbers in a row of :attr:`visible_values`."""
    factors: tuple[str, ...]
    factor_labels: tuple[tuple[str, ...], ...]
    """Names of the values of each factor."""
    features: tuple[tuple[str, int, int], ...]
    """``(name, factor, value)``, 0-based."""
    shapings: tuple[str, ...]
    """Names of the rewards in ``arrays["outcome_reward"]``; the first, ``"none"``, is the true one."""
    layout: Mapping[str, Any]
    """What is needed to draw the domain."""
    provenance: Mapping[str, Any]
    """Where the tables come from: date, Julia and package versions, source files and their hash."""
    arrays: Mapping[str, NDArray[Any]] = field(repr=False)
    shaping: str = "none"
    """Which reward is in use."""
    live: Any = field(default=None, repr=False)
    """The Julia model, for a domain made from live Julia; None for a named instance."""
    sensors: tuple[Sensor, ...] = ()
    """What is read unasked after every step; none in most domains."""
    agents: tuple[Agent, ...] = ()
    """Who acts, each by its own readings; none where one controller does. The domain's actions and observations are the
    combinations of theirs, the last agent's running fastest, so that it is itself the problem of one controller that
    sees what all of them read (an MPOMDP: Pynadath and Tambe, JAIR 16, 2002)."""

    def __eq__(self, other: object) -> bool:
        """Whether it is the same model under the same name, version and shaping, read from wherever."""
        return self is other or (isinstance(other, Domain) and self._identity == other._identity)

    def __hash__(self) -> int:
        """Of what makes two equal."""
        return hash(self._identity)

    @cached_property
    def _identity(self) -> tuple[str, int, str, str]:
        return self.name, self.version, self.shaping, self.model_hash

    def __getstate__(self) -> dict[str, Any]:
        """The fields without the live Julia model, which lives in this process only."""
        return {each.name: getattr(self, each.name) for each in fields(self)} | {"live": None}

    def __deepcopy__(self, memo: dict[int, Any]) -> Domain:
        """Itself: nothing in it changes, and copies of policies that hold a domain shall not hold all its arrays."""
        return self

    @property
    def notes(self) -> tuple[str, ...]:
        """Of a domain from a model file: what the file's variables have become here, and what was lost."""
        return tuple(self.provenance.get("notes", ()))

    @property
    def in_julia(self) -> bool:
        """Whether Julia has a definition of it, which domains from model files and arrays have not."""
        return "model file" not in self.provenance

    @property
    def n_actions(self) -> int:
        """Number A of actions."""
        return len(self.actions)

    @property
    def n_observations(self) -> int:
        """Number O of observations."""
        return len(self.observations)

    @property
    def n_labels(self) -> int:
        """Combinations of the sensors' labels; 1 where there are none."""
        return math.prod(len(sensor.labels) for sensor in self.sensors)

    def labels_of(self, observations: NDArray[Any]) -> NDArray[np.int64]:
        """(…, J) index of each sensor's label in observations (…)."""
        sizes = [len(sensor.labels) for sensor in self.sensors]
        return observations[..., None] // strides(sizes) % np.array(sizes, dtype=np.int64)

    @property
    def n_visible(self) -> int:
        """Number V of visible values, terminal ones included."""
        return len(self.visible_values)

    @cached_property
    def factor_sizes(self) -> tuple[int, ...]:
        """Number of values of each hidden factor."""
        return tuple(len(labels) for labels in self.factor_labels)

    @cached_property
    def n_marginals(self) -> int:
        """Number N of values of all factors together."""
        return sum(self.factor_sizes)

    @property
    def n_joint(self) -> int:
        """Number H of joint values of the hidden factors (256 for eight rocks)."""
        return math.prod(self.factor_sizes)

    @property
    def visible_values(self) -> NDArray[np.int16]:
        """(V, len(visible_names)) what a visible index stands for, for example the robot's x and y."""
        return self.arrays["visible_values"]

    @cached_property
    def factor_offset(self) -> NDArray[np.int64]:
        """(K + 1,) position of each factor in the concatenated marginals."""
        return np.concatenate([[0], np.cumsum(self.factor_sizes)]).astype(np.int64)

    @cached_property
    def factor_of(self) -> NDArray[np.int64]:
        """(N,) factor that each of the concatenated marginals belongs to."""
        return np.repeat(np.arange(len(self.factors), dtype=np.int64), self.factor_sizes)

    @cached_property
    def feature_columns(self) -> NDArray[np.int64]:
        """(F,) columns of the marginals that the features stand for."""
        return np.array([self.factor_offset[k] + x for _, k, x in self.features], dtype=np.int64)

    @cached_property
    def tables(self) -> Tables:
        """The arrays in the form that compiled code takes, with the reward of :attr:`shaping`."""
        sensors = [(sensor.factor, len(sensor.labels)) for sensor in self.sensors]
        shaping = self.shapings.index(self.shaping)
        return from_arrays(self.arrays, self.n_actions, self.factor_offset, shaping, sensors)

    @property
    def nothing(self) -> int:
        """The observation that tells nothing, called "none"; −1 where each tells something."""
        return self.observations.index("none") if "none" in self.observations else -1

    @cached_property
    def sure(self) -> Records:
        """(V·A,) what is sure of a step before it is taken (:data:`harness.model.certainty.SURE`)."""
        return sure(self.tables, self.nothing)

    @cached_property
    def legality(self) -> NDArray[np.int8]:
        """(V, A) 1 where an action is legal whatever is hidden, 0 where it is not, −1 where the belief decides."""
        first = np.maximum(self.arrays["first_row"], 0)  # a terminal value has none, and nobody asks of it
        count = np.array([*self.factor_sizes, 1])[self.arrays["factor"]]  # rows of a choice; factor −1 is the last
        before = np.concatenate([[0], np.cumsum(self.arrays["legal"])])
        legal = before[np.minimum(first + count, len(before) - 1)] - before[first]
        decided = np.where(legal == count, 1, np.where(legal == 0, 0, -1))
        return decided.astype(np.int8).reshape(self.n_visible, self.n_actions)

    @cached_property
    def model_hash(self) -> str:
        """SHA-256 of all that decides the domain's behaviour; policies record the one they were solved for."""
        record = [self.discount, self.actions, self.observations, self.factor_labels, self.features, self.shapings]
        more = [each for each in (self.sensors, self.agents) if each]  # what most domains lack leaves their hash alone
        return archive.digest(self.arrays, [*record, *more])

    def action(self, name: str) -> int:
        """Index of the action called ``name``.

        Raises:
            HarnessError: there is no such action.
        """
        if name not in self.actions:
            raise HarnessError(
                f"{self.name} has no action {quoted(name)}{nearest(name, self.actions)} "
                f"(actions: {' '.join(self.actions)})"
            )
        return self.actions.index(name)

    def shaped(self, shaping: str) -> Domain:
        """The same domain with another reward shaping.

        Raises:
            HarnessError: the domain does not know the shaping.
        """
        if shaping not in self.shapings:
            raise HarnessError(
                f"{self.name} has no reward shaping {quoted(shaping)}{nearest(shaping, self.shapings)} "
                f"(known: {', '.join(self.shapings)})"
            )
        return replace(self, shaping=shaping)

    def _facts(self) -> dict[str, object]:
        shaping = {} if self.shaping == "none" else {"shaping": self.shaping}
        return {
            "version": self.version,
            "states": f"{self.n_states:,}",
            "actions": self.n_actions,
            "observations": self.n_observations,
            "discount": self.discount,
            **shaping,
        }

    def __repr__(self) -> str:
        """Name and sizes, on one line."""
        return cards.line("Domain", self.name, self._facts())

    def _repr_html_(self) -> str:
        return cards.card("Domain", self.name, {"title": self.title, **self._facts()})


def from_export(record: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]], live: Any = None) -> Domain:
    """A domain from what the Julia package exports: names and provenance, and the arrays of ``julia/src/tables.jl``."""
    sensors = tuple(Sensor(str(name), int(k), tuple(labels)) for name, k, labels in record.get("sensors", ()))
    agents = tuple(Agent(str(name), tuple(does), tuple(reads)) for name, does, reads in record.get("agents", ()))
    return Domain(
        name=record["name"],
        version=int(record["version"]),
        title=record["title"],
        discount=float(record["discount"]),
        n_states=int(record["states"]),
        actions=tuple(record["actions"]),
        observations=tuple(record["observations"]),
        visible_names=tuple(record["visible"]),
        factors=tuple(record["factors"]),
        factor_labels=tuple(tuple(labels) for labels in record["factor_labels"]),
        features=tuple((str(name), int(k), int(x)) for name, k, x in record["features"]),
        shapings=tuple(record["shapings"]),
        layout=record["layout"],
        provenance=record["provenance"],
        arrays={name: np.ascontiguousarray(arrays[name], dtype=dtype) for name, dtype in types(sensors).items()},
        live=live,
        sensors=sensors,
        agents=agents,
    )


def to_record(domain: Domain) -> dict[str, Any]:
    """Inverse of :func:`from_export`, as far as the record goes."""
    return {
        "name": domain.name,
        "version": domain.version,
        "title": domain.title,
        "discount": domain.discount,
        "states": domain.n_states,
        "actions": domain.actions,
        "observations": domain.observations,
        "visible": domain.visible_names,
        "factors": domain.factors,
        "factor_labels": domain.factor_labels,
        "features": domain.features,
        "shapings": domain.shapings,
        "layout": dict(domain.layout),
        "provenance": dict(domain.provenance),
        **({"sensors": domain.sensors} if domain.sensors else {}),
        **({"agents": domain.agents} if domain.agents else {}),
    }


def save(domain: Domain, path: Path) -> None:
    """Write the domain as a snapshot."""
    values = np.asfortranarray(domain.arrays["start_values"])  # factor by factor, where most repeats: it packs well
    archive.write(path, KIND, to_record(domain), {**domain.arrays, "start_values": values})


def read(path: Path) -> Domain:
    """Read a snapshot.

    Raises:
        SnapshotError: the file is damaged or is no snapshot, or its arrays make no domain (the first fault is named).
    """
    record, arrays = archive.read(path, KIND)
    _refuse(path, itertools.chain(validation.record_breaches(record), _type_breaches(record, arrays)))
    domain = from_export(record, arrays)
    _refuse(path, validation.breaches(domain))
    return domain


def _type_breaches(record: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Iterator[str]:
    yield from validation.type_breaches(arrays, types(record.get("sensors", ())))


def _refuse(path: Path, breaches: Iterator[str]) -> None:
    for first in breaches:
        raise SnapshotError(f"{path}: {first}; export it again")
