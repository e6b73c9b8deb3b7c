"""The ask-and-tell contract between a way of tuning and whatever plays the episodes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from harness.errors import HarnessError, nearest, quoted
from harness.tuning.tunable import Tunable, Vector

MOST_STEPS = 1_000_000
"""The longest horizon."""

MOST_EPISODES = 10_000_000
"""The most at a point, and at all points of an iteration together: what is kept of them takes some 0.2 GB."""

_MOST = 1_000_000
"""The highest value of a setting that names no other."""


class Softness(NamedTuple):
    """How comparisons with constants become gates (:func:`harness.smooth`)."""

    temperature: float
    """τ"""
    situations: int
    """Of a step at most."""


@dataclass(frozen=True)
class Ask:
    """Points at which the return is wanted."""

    points: NDArray[np.float64]
    """(n, d), each within the bounds."""
    first: NDArray[np.int64]
    """(n,) number of each point's first episode. Points with the same one meet the same episodes: common random
    numbers."""
    episodes: int
    """How many, at each point."""
    soft: Softness | None = None
    """Where it is given, the smooth return of a single point is wanted, with its gradient, instead of episodes."""


@dataclass(frozen=True)
class Move:
    """What a method made of the answers."""

    step: float
    """Length of the move, the largest over the d numbers."""
    rate: float = math.nan
    """Step size in use: α_t of the paper, a_k of SPSA, σ of CMA-ES."""
    gradient: Vector | None = None
    """(d,) as estimated, before clipping."""
    velocity: Vector | None = None
    """(d,) v of the paper's eq. 4, after clipping."""
    stop: str = ""
    """Why the method has finished, as the end of a sentence; empty to go on."""


class Method(Protocol):
    """A way uphill. Deterministic: the same answers give the same questions, in any process.

    Its settings are dataclass fields made by :func:`setting`.
    """

    theta: Vector
    """(d,) where it stands: the result, once it has finished."""
    iterations: int
    """The most it may ask."""

    def ask(self, iteration: int) -> Ask:
        """The points of an iteration, counted from 0."""

    def tell(self, iteration: int, ask: Ask, values: Vector) -> Move:
        """Move on. ``values``: (n,) mean return at each point asked for; of a soft one (1 + d,) return and gradient."""


def setting(default: float, low: float, high: float = _MOST) -> Any:
    """A field of a method: a number in [low, high] that a user may set; a whole number where the default is one."""
    return field(default=default, metadata={"low": low, "high": high})


def settings_of(method: Any) -> dict[str, float]:
    """Names and values of a method's settings (for the class: the defaults)."""
    return {f.name: getattr(method, f.name) for f in fields(method) if "low" in f.metadata}


def check_number(name: str, value: Any, whole: bool, low: float, high: float) -> None:
    """Check something that a user may set.

    Raises:
        HarnessError: it is no number, not a whole one where it must be, or not in [low, high].
    """
    if not isinstance(value, int if whole else (int, float)) or isinstance(value, bool) or not low <= value <= high:
        kind = "whole number" if whole else "number"
        raise HarnessError(f"{name} must be a {kind} from {low:,} to {high:,}, not {quoted(value)}")


def configure(kind: type[Any], subject: Tunable, seed: int, settings: Mapping[str, Any]) -> Method:
    """A method of the class ``kind`` with its settings checked.

    Raises:
        HarnessError: a setting is unknown, of the wrong type or out of range.
    """
    known = {f.name: f for f in fields(kind) if "low" in f.metadata}
    for name, value in settings.items():
        if name not in known:
            raise HarnessError(f"no setting {quoted(name)}{nearest(name, known)} (of this method: {', '.join(known)})")
        limits = known[name].metadata
        check_number(name, value, isinstance(known[name].default, int), limits["low"], limits["high"])
    method: Method = kind(subject, seed, **settings)
    return method
