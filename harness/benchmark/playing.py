"""The episodes of a row in parts that take seconds: a kill loses those under way and no more."""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness import policy as policies
from harness.model.domain import Domain
from harness.play.evaluation import EPISODES, HORIZON, Evaluation, evaluate
from harness.policy import Policy
from harness.policy.base import whole

SEED = 0
ENGINE = "tables"
"""That of both engines which every domain has; the numbers are the same."""

_CUT = 0.1
"""Weight of a reward after :data:`HORIZON` steps from which on too much is earned later to cut episodes there."""
REST = 0.01
"""Weight of a reward at which endless episodes are cut."""
_LONG, _SHORT = 1_000, 2  # episodes of a part; the short ones of policies that plan by simulation
ARRAYS = ("returns", "discounted", "steps", "terminated")


class Part(NamedTuple):
    """Some episodes of a row."""

    policy: str
    first: int
    episodes: int


class Played(NamedTuple):
    """What came out of them."""

    arrays: dict[str, NDArray[Any]]
    """Of :class:`~harness.play.evaluation.Evaluation`, by ``ARRAYS``."""
    seconds: float
    """On one core, code compiled before or on the way."""


def horizon(domain: Domain) -> int:
    """Steps of an episode: as in any comparison, but where there is no end, or hardly a discount, until little is left.

    The optimal value, which returns are set beside, is of episodes without a horizon.
    """
    if domain.tables.outcomes["ends"].any() and domain.discount**HORIZON < _CUT:
        return HORIZON
    return math.ceil(math.log(REST) / math.log(domain.discount)) if domain.discount < 1 else HORIZON


@functools.lru_cache(maxsize=32)
def policy_of(domain: Domain, spec: str) -> Policy:
    """The policy of a string, made once in a process: some read large files, or solve, before they can act."""
    return policies.make(spec, domain)[1]


def parts(policy: Policy, spec: str, episodes: int) -> list[Part]:
    """All episodes of a row."""
    size = _LONG if whole(policy, "max_episodes", EPISODES) >= EPISODES else _SHORT
    return [Part(spec, first, min(size, episodes - first)) for first in range(0, episodes, size)]


def play(domain: Domain, part: Part) -> Played:
    """A part, in one thread of a worker (:mod:`harness.play.executor`) or in all of this process."""
    began = time.perf_counter()
    made = policy_of(domain, part.policy)
    result = evaluate(
        domain,
        made,
        episodes=part.episodes,
        seed=SEED,
        first=part.first,
        horizon=horizon(domain),
        engine=ENGINE,
        workers=1,
    )
    return Played({name: getattr(result, name) for name in ARRAYS}, time.perf_counter() - began)


def joined(domain: Domain, spec: str, played: Sequence[Played]) -> tuple[Evaluation, float]:
    """All parts of a row, in order, as one evaluation, and their seconds."""
    arrays = {name: np.concatenate([each.arrays[name] for each in played]) for name in ARRAYS}
    return Evaluation(domain, spec, ENGINE, SEED, horizon(domain), **arrays), sum(each.seconds for each in played)


def long_first(pieces: Iterable[Part]) -> list[Part]:
    """Those that plan by simulation first, so that at the end no core waits long for another."""
    return sorted(pieces, key=lambda part: part.episodes)
