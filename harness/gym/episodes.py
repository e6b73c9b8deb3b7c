"""Which episodes an environment plays, and what of them both kinds of environment show."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from harness import registry
from harness.engine import rng
from harness.engine.batch import Batch
from harness.errors import check_whole
from harness.model.domain import Domain
from harness.play.evaluation import check_played
from harness.policy.encoding import Encoding


def loaded(domain: Domain | str, horizon: int) -> Domain:
    """The domain meant, once the horizon has been looked at.

    Raises:
        HarnessError: there is no such domain, or the horizon is out of range.
    """
    check_played(seed=0, horizon=horizon)
    return registry.load(domain) if isinstance(domain, str) else domain


def observation_space(encoding: Encoding) -> spaces.Box:
    """What an encoding's vectors lie in."""
    return spaces.Box(0.0, 1.0, (encoding.size,), np.float32)


def unscored_seed(generator: np.random.Generator) -> int:
    """A seed for whoever gave none: of the range for learning, which no evaluation plays."""
    return rng.TRAINING + int(generator.integers(1 << 61))


def first_number(options: Mapping[str, Any] | None, seed: int | None) -> int | None:
    """Number of the first episode after a reset: what ``options={"first": k}`` says, else 0 for a new seed.

    None: with neither of them, every lane goes on with its next episode.

    Raises:
        HarnessError: the seed or the number is out of range.
    """
    first = (options or {}).get("first", None if seed is None else 0)
    check_played(seed=seed or 0, horizon=1, first=first)
    return first


def check_lanes(number: int) -> None:
    """Check a number of environments.

    Raises:
        HarnessError: it is none, or out of range.
    """
    check_whole("num_envs", number, 1, 1 << 31)


def action_mask(batch: Batch) -> NDArray[np.int8]:
    """(E, A) 1 where an action costs no illegal-move penalty as far as the belief can tell (``Batch.legal``).

    All 1 for an episode that has ended, whose action is ignored: who samples under a mask needs something to take.
    """
    mask = batch.legal()
    mask[batch.done] = True
    return mask.view(np.int8)
