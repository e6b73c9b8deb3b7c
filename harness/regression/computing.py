"""The expected return of a row, computed, and whether it is the stored one."""

from __future__ import annotations

import functools
import math

from harness.expectation.acting import NotExact
from harness.expectation.forward import exact
from harness.model.domain import Domain
from harness.policy import Policy
from harness.regression.rows import Row, StoredExact
from harness.score.table import EXACT, INTERVAL

_LAST_BITS = 1e-12  # a sum's, beside the bound that goes with it


def compute(row: Row, domain: Domain, policy: Policy) -> tuple[StoredExact, float]:
    """The row's score, and a bound of what rounding may have changed in its returns.

    Raises:
        NotExact: the policy draws random numbers, or does not say what it remembers.
    """
    try:
        found = exact(domain, policy, horizon=row.horizon)
    except NotExact as error:  # which calls the policy by the name of its class
        raise NotExact(f"{str(error).partition(': ')[2]}; leave how out of the row") from None
    score = StoredExact(
        domain=row.domain,
        policy=row.policy,
        horizon=row.horizon,
        how=EXACT if found.is_exact else INTERVAL,
        domain_version=domain.version,
        model_hash=domain.model_hash,
        mean_low=found.mean.low,
        mean_high=found.mean.high,
        discounted_low=found.discounted.low,
        discounted_high=found.discounted.high,
        steps_mean=found.steps.middle,
        success_rate=found.success.middle,
    )
    return score, found.rounding


def equal(stored: StoredExact, fresh: StoredExact, rounding: float) -> bool:
    """Whether two scores are the same but for rounding: each may be off by as much as today's computation may."""
    close = functools.partial(math.isclose, rel_tol=_LAST_BITS, abs_tol=2 * rounding + _LAST_BITS)
    same = all(close(getattr(stored, name), getattr(fresh, name)) for name in StoredExact.SHOWN)
    return stored.how == fresh.how and same


def drop(before: StoredExact, after: StoredExact) -> float:
    """How much the return has fallen at least; below 0 where nothing proves that it has."""
    return before.mean_low - after.mean_high
