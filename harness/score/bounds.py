"""What there is to earn, as far as it is stored with the package: bounds of the optimal value, and of the return."""

from __future__ import annotations

from typing import Any

from harness import registry
from harness.model.domain import Domain
from harness.policy import Policy
from harness.solver import solution
from harness.solver.solution import Bounds

OPTIMUM = "optimum"
"""The row of the optimal value's upper bound, proven by ``harness solve``; its undiscounted return is that of MDP."""
MDP = "mdp"
"""The row of the value with everything observed."""
NAMES = (OPTIMUM, MDP)


def optimum(domain: Domain) -> Bounds | None:
    """The bounds that ``harness solve`` has proven; None where none are stored.

    Raises:
        SnapshotError: the file is damaged or belongs to another model.
    """
    return _proven(domain) if registry.stored_policy(domain, solution.OWN) else None


def of_policy(policy: Policy | None) -> Bounds | None:
    """The bounds that a policy came with, from where our solver found it; else None."""
    return solution.bounds(getattr(policy, "record", {}))


def default(domain: Domain) -> list[str]:
    """The bound that a domain's table ends with: the closest one there is."""
    words = {OPTIMUM: solution.OWN, MDP: MDP}
    return [name for name in NAMES if registry.stored_policy(domain, words[name])][:1]


def cells(domain: Domain, name: str, horizon: int) -> dict[str, Any]:
    """The cells of a bound's row.

    Raises:
        SnapshotError: nothing is stored for the domain, the file is damaged or belongs to another model.
    """
    if name == MDP:
        return _everything_observed(domain, horizon)
    known, proven = registry.stored_policy(domain, MDP), _proven(domain)
    mean = _everything_observed(domain, horizon)["mean"] if known else None
    return {"mean": mean, "discounted_mean": None if proven is None else proven.high}


def _proven(domain: Domain) -> Bounds | None:
    path = registry.policy_path(domain.name, solution.OWN)
    return solution.bounds(solution.read(path, domain, *solution.OWN_KINDS).record)


def _everything_observed(domain: Domain, horizon: int) -> dict[str, Any]:
    record = solution.read(registry.policy_path(domain.name, MDP), domain, solution.BOUND_KIND).record
    mean = record["undiscounted"] if record["horizon"] == horizon else None
    return {"mean": mean, "discounted_mean": record["discounted"]}


def share(mean: float, known: Bounds | None) -> dict[str, float | None]:
    """The columns that say how much of the optimum a policy's mean discounted return earns, as an interval."""
    if known is None:
        return {}
    low, high = sorted((mean / known.high, mean / known.low)) if known.low > 0 else (None, None)
    return {"share_low": low, "share_high": high, "optimum_low": known.low, "optimum_high": known.high}
