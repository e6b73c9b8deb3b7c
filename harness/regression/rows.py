"""What a score check is about: the rows to score, the scores stored for them, and the limits of the comparison."""

from __future__ import annotations

import dataclasses
import math
import typing
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, TypeVar

from harness.engine import ENGINES
from harness.errors import HarnessError, nearest, quoted
from harness.play.evaluation import EPISODES, HORIZON
from harness.regression import statistics
from harness.score.table import EXACT, INTERVAL, SAMPLED

FEWEST_EPISODES = 30
"""Fewer than these give no test of a mean that keeps its error rate."""

STRETCH = 20
"""A stored score rests on at most so many times the row's episodes, unless its ``max_episodes`` says otherwise."""

Key = tuple[str, str, int, str]
"""Domain, policy, horizon, and ``sampled`` or ``exact``: what a stored score belongs to."""


@dataclass(frozen=True)
class Limits:
    """The comparison's error rates; explained where they are used, in :mod:`harness.regression.statistics`."""

    false_alarm: float = statistics.FALSE_ALARM
    min_effect: float = statistics.MIN_EFFECT
    drop: float = statistics.DROP
    power: float = statistics.POWER

    def __post_init__(self) -> None:
        """Refuse what makes no test."""
        for name in ("false_alarm", "power"):
            if not 0 < getattr(self, name) < 1:
                raise HarnessError(f"{name} must lie between 0 and 1, not be {getattr(self, name)}")
        if not 0 <= self.min_effect < math.inf:
            raise HarnessError(f"min_effect must be 0 or more, not {self.min_effect}")
        if not self.min_effect < self.drop < math.inf:
            raise HarnessError(f"drop must be larger than min_effect ({self.min_effect}), not {self.drop}")


@dataclass(frozen=True)
class Row:
    """A policy on a domain, and how it is scored."""

    domain: str
    policy: str
    episodes: int = EPISODES
    """Those that are compared one by one with the stored ones."""
    seed: int = 0
    horizon: int = HORIZON
    engine: str = "auto"
    max_episodes: int | None = None
    """At most so many episodes for the stored score, and for a check in doubt; by default 20 times ``episodes``."""
    how: str = SAMPLED
    """``exact``: the expected return is computed (:func:`harness.exact`), and there are no episodes."""

    def __post_init__(self) -> None:
        """Refuse what cannot be scored."""
        if self.how not in (SAMPLED, EXACT):
            raise HarnessError(f"how must be '{SAMPLED}' or '{EXACT}', not {quoted(self.how)}")
        if self.how == EXACT:
            self._refuse_sampling()
        if self.episodes < FEWEST_EPISODES:
            raise HarnessError(f"episodes must be {FEWEST_EPISODES} or more, not {self.episodes}")
        if not 0 <= self.seed < 2**63:
            raise HarnessError(f"seed must be a whole number from 0 to 2**63 - 1, not {self.seed}")
        if self.horizon < 1:
            raise HarnessError(f"horizon must be 1 or more, not {self.horizon}")
        if self.max_episodes is not None and self.max_episodes < self.episodes:
            raise HarnessError(f"max_episodes ({self.max_episodes}) must not be below episodes ({self.episodes})")

    def _refuse_sampling(self) -> None:
        defaults = {field.name: field.default for field in dataclasses.fields(self)}
        for name in ("episodes", "seed", "engine", "max_episodes"):
            if getattr(self, name) != defaults[name]:
                raise HarnessError(f"{name} is of sampled rows only; leave it out where how is '{EXACT}'")

    @property
    def key(self) -> Key:
        """What its stored score is found by."""
        return self.domain, self.policy, self.horizon, self.how

    @property
    def most(self) -> int:
        """Episodes at most."""
        return self.max_episodes or STRETCH * self.episodes


@dataclass(frozen=True)
class StoredScore:
    """A score with its origin, as it is kept in the file."""

    domain: str
    policy: str
    horizon: int
    domain_version: int
    model_hash: str
    """SHA-256 of the domain's tables: scores on another model are not comparable."""
    engine: str
    seed: int
    episodes: int
    digest: str
    """SHA-256 of the first ``episodes`` returns (plain and discounted), lengths and ends."""
    reference_episodes: int
    """Episodes behind the numbers below: ``episodes``, or more where a drop could not be told from noise otherwise."""
    mean: float
    sem: float
    discounted_mean: float
    discounted_sem: float
    steps_mean: float
    success_rate: float

    def __post_init__(self) -> None:
        """Refuse what no score can be."""
        for name, least in (("horizon", 1), ("seed", 0), ("episodes", FEWEST_EPISODES)):
            if getattr(self, name) < least:
                raise HarnessError(f"{name} must be {least} or more, not {getattr(self, name)}")
        if self.reference_episodes < self.episodes:
            raise HarnessError(f"reference_episodes must be {self.episodes} or more, not {self.reference_episodes}")
        if self.engine not in ENGINES:
            raise HarnessError(f"engine must be {' or '.join(ENGINES)}, not '{self.engine}'")
        for name in ("sem", "discounted_sem", "steps_mean", "success_rate"):
            if getattr(self, name) < 0:
                raise HarnessError(f"{name} must be 0 or more, not {getattr(self, name)}")

    SHOWN: ClassVar = (
        "mean", "sem", "discounted_mean", "discounted_sem", "steps_mean", "success_rate", "reference_episodes",
    )  # fmt: skip
    """What a side by side shows of it."""

    @property
    def key(self) -> Key:
        """What belongs to it."""
        return self.domain, self.policy, self.horizon, SAMPLED

    @property
    def text(self) -> str:
        """The mean return, to be read."""
        return f"{self.mean:.2f} ± {self.sem:.2f}"

    @property
    def summary(self) -> tuple[float, float, int]:
        """Mean, standard error and number of episodes."""
        return self.mean, self.sem, self.reference_episodes


@dataclass(frozen=True)
class StoredExact:
    """An expected return with its origin, as it is kept in the file: nothing in it is sampled."""

    domain: str
    policy: str
    horizon: int
    how: str
    """``exact``, or ``interval`` where not all situations could be expanded."""
    domain_version: int
    model_hash: str
    mean_low: float
    mean_high: float
    """What the return is proven to lie between; equal where it is exact."""
    discounted_low: float
    discounted_high: float
    steps_mean: float
    success_rate: float
    """Of an interval its middle, like the steps."""

    SHOWN: ClassVar = ("mean_low", "mean_high", "discounted_low", "discounted_high", "steps_mean", "success_rate")
    sem: ClassVar = 0.0
    """None is sampled."""

    def __post_init__(self) -> None:
        """Refuse what no score can be."""
        if self.how not in (EXACT, INTERVAL):
            raise HarnessError(f"how must be '{EXACT}' or '{INTERVAL}', not {quoted(self.how)}")
        if self.horizon < 1:
            raise HarnessError(f"horizon must be 1 or more, not {self.horizon}")
        for name in ("steps_mean", "success_rate"):
            if getattr(self, name) < 0:
                raise HarnessError(f"{name} must be 0 or more, not {getattr(self, name)}")
        for name in ("mean", "discounted"):
            low, high = getattr(self, f"{name}_low"), getattr(self, f"{name}_high")
            if low > high or (self.how == EXACT and low != high):
                raise HarnessError(f"{name}_low is {low}, which does not go with {name}_high = {high}")

    @property
    def key(self) -> Key:
        """What belongs to it."""
        return self.domain, self.policy, self.horizon, EXACT

    @property
    def mean(self) -> float:
        """The return; of an interval its middle."""
        return (self.mean_low + self.mean_high) / 2

    @property
    def discounted_mean(self) -> float:
        """The discounted return; of an interval its middle."""
        return (self.discounted_low + self.discounted_high) / 2

    @property
    def text(self) -> str:
        """The mean return, to be read."""
        return f"{self.mean:.4f}" if self.how == EXACT else f"{self.mean_low:.4f} to {self.mean_high:.4f}"


AnyScore = StoredScore | StoredExact


class FieldFault(HarnessError):
    """A key of a table is missing, unknown, or has a wrong value; ``key`` says which."""

    def __init__(self, key: str, message: str) -> None:
        """``key``: the empty string where none is at fault by itself."""
        super().__init__(message)
        self.key = key


_T = TypeVar("_T")
_WORDS = {str: "a text", int: "a whole number", float: "a number"}


def from_table(kind: type[_T], table: Mapping[str, Any]) -> _T:
    """A :class:`Row`, a stored score or :class:`Limits` from a TOML table.

    Raises:
        FieldFault: keys and fields differ, or a value is of the wrong type, out of range, or not finite.
    """
    fields = {field.name: field for field in dataclasses.fields(kind)}  # type: ignore[arg-type]
    for key in table:
        if key not in fields:
            hint = f"{nearest(key, fields)} (known: {', '.join(fields)})"
            raise FieldFault(key, f"no key {quoted(key)} is known here{hint}")
    for name, field in fields.items():
        if name not in table and field.default is dataclasses.MISSING:
            raise FieldFault("", f"'{name}' is missing")
    types = typing.get_type_hints(kind)
    values = {key: _value(key, value, types[key]) for key, value in table.items()}
    try:
        return kind(**values)
    except HarnessError as error:
        key = next((name for name in fields if str(error).startswith(f"{name} ")), "")
        raise FieldFault(key, str(error)) from None


def _value(key: str, value: Any, wanted: Any) -> Any:
    wanted = int if wanted == int | None else wanted
    fits = isinstance(value, (int, float) if wanted is float else wanted) and not isinstance(value, bool)
    if not fits:
        raise FieldFault(key, f"'{key}' must be {_WORDS[wanted]}, not {quoted(value)}")
    if wanted is float:
        if not math.isfinite(value):
            raise FieldFault(key, f"'{key}' is {value}, no finite number")
        return float(value)
    return value
