"""What can be tuned: policies with named numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from harness import policy as policies
from harness.errors import HarnessError, PolicyError, nearest, quoted
from harness.model.domain import Domain
from harness.policy import Policy, own, thresholds
from harness.policy.program import ProgramPolicy
from harness.program import parse, words_of
from harness.tuning.constants import Constants, Vector

__all__ = ["Constants", "Heuristic", "Tunable", "Vector", "index_of", "tunable"]


@runtime_checkable
class Tunable(Protocol):
    """A policy with d numbers to tune. All bounds are finite, ``lower ≤ start ≤ upper``.

    The numbers should be of like scale (all ours lie in [0, 1]): one difference and one step size serve them all.
    """

    @property
    def names(self) -> tuple[str, ...]:
        """(d,) different names, usable as column names."""

    @property
    def lower(self) -> Vector:
        """(d,)"""

    @property
    def upper(self) -> Vector:
        """(d,)"""

    @property
    def start(self) -> Vector:
        """(d,)"""

    def policy(self, theta: Vector) -> Policy:
        """The policy at ``theta`` (d,)."""

    def text(self, theta: Vector) -> str:
        """What names that policy, for people and, where there is one, as a policy string: ``belief:0.8439``."""


@dataclass(frozen=True, eq=False)
class Heuristic:
    """A heuristic of :mod:`harness.policy` whose policy string holds its numbers."""

    domain: Domain
    word: str
    names: tuple[str, ...]
    lower: Vector
    upper: Vector
    start: Vector

    def policy(self, theta: Vector) -> Policy:
        """The policy that :meth:`text` names."""
        return policies.make(self.text(theta), self.domain)[1]

    def text(self, theta: Vector) -> str:
        """The policy string; its numbers read back exactly as they are."""
        numbers = [repr(float(x)) for x in theta]
        if self.names == ("threshold",):
            return f"{self.word}:{numbers[0]}"
        return f"{self.word}:" + ",".join(f"{name}={x}" for name, x in zip(self.names, numbers, strict=True))


_WHAT = "tunable policy: an object with names, lower, upper, start, policy(theta) and text(theta)"
_BOUNDS = {
    "accuracy": {"threshold": (0.5, 1.0)},
    "belief": {"threshold": (0.5, 1.0)},
    "thresholds": thresholds.BOUNDS,
}


def tunable(spec: str | Tunable, domain: Domain) -> Tunable:
    """What a policy string makes tunable, from the numbers it gives (or the policy's defaults) as the start.

    A program is named by its file (``program:FILE``), or given as its text, which has line ends: so a run's
    ``config.json`` holds all that it came from. A Tunable of the user's own is named by its path (``own.py:Name``).

    Raises:
        PolicyError: the string means nothing on this domain, a number is out of range, or nothing in it can be tuned.
    """
    if not isinstance(spec, str):
        if isinstance(spec, Tunable):
            return spec
        raise PolicyError(f"{type(spec).__name__} cannot be tuned: an object of the Tunable protocol is needed")
    if own.is_path(spec) and policies.names_code(spec) and own.is_there(spec):
        return own.load(spec, domain, Tunable, _WHAT)
    if "\n" in spec:
        return Constants(parse(spec, words_of(domain)))
    text, made = policies.make(spec, domain)  # checks it and fills in the defaults
    word, _, numbers = text.partition(":")
    if isinstance(made, ProgramPolicy):
        return Constants(made.program)
    if word not in _BOUNDS:
        known = ", ".join([*_BOUNDS, "program:FILE"])
        raise PolicyError(f"policy {quoted(word)} has no numbers to tune (those that have: {known})")
    if word == "thresholds":
        start = np.array(list((thresholds.DEFAULTS | thresholds.parse(numbers)).values()))
    else:
        start = np.array([float(numbers)])
    bounds = _BOUNDS[word]
    lower, upper = np.array(list(bounds.values())).T
    return Heuristic(domain, word, tuple(bounds), lower.copy(), upper.copy(), start)


def index_of(subject: Tunable, name: str | None) -> int:
    """Position of the number called ``name``; with one number, None means that one.

    Raises:
        HarnessError: there is no such number, or none was named and there are several.
    """
    known = ", ".join(subject.names)
    if name is None:
        if len(subject.names) > 1:
            raise HarnessError(f"name the parameter to vary, one of: {known}")
        return 0
    if name not in subject.names:
        raise HarnessError(f"no parameter {quoted(name)}{nearest(name, subject.names)} (known: {known})")
    return subject.names.index(name)
