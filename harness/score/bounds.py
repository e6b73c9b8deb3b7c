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


def optimum(domain: Domain, policy: Policy | None = None) -> Bounds | None:
    """The bounds that ``harness solve`` has proven: those stored with the package, else those a policy came with.

    Raises:
        SnapshotError: the stored file is damaged or belongs to another model.
    """
    path = registry.policy_path(domain.name, solution.OWN)
    if path.exists():
        return solution.bounds(solution.read(path, domain, *solution.OWN_KINDS).record)
    return solution.bounds(getattr(policy, "record", {}))


def default(domain: Domain) -> list[str]:
    """The bound that a domain's table ends with: the closest one there is."""
    words = {OPTIMUM: solution.OWN, MDP: MDP}
    return [name for name in NAMES if registry.policy_path(domain.name, words[name]).exists()][:1]


def cells(domain: Domain, name: str, horizon: int) -> dict[str, Any]:
    """The cells of a bound's row.

    Raises:
        SnapshotError: nothing is stored for the domain, the file is damaged or belongs to another model.
    """
    known, found = _everything_observed(domain, horizon, needed=name == MDP), None
    if name == OPTIMUM and (found := optimum(domain)) is None:
        solution.read(registry.policy_path(domain.name, solution.OWN), domain)  # says that there is no such file
    return known if found is None else known | {"discounted_mean": found.high}


def _everything_observed(domain: Domain, horizon: int, *, needed: bool) -> dict[str, Any]:
    path = registry.policy_path(domain.name, MDP)
    if not needed and not path.exists():
        return {"mean": None}
    record = solution.read(path, domain, solution.BOUND_KIND).record
    mean = record["undiscounted"] if record["horizon"] == horizon else None
    return {"mean": mean, "discounted_mean": record["discounted"]}


def share(mean: float, known: Bounds | None) -> dict[str, float | None]:
    """The columns that say how much of the optimum a policy's mean discounted return earns, as an interval."""
    if known is None:
        return {}
    low, high = sorted((mean / known.high, mean / known.low)) if known.low > 0 else (None, None)
    return {"share_low": low, "share_high": high, "optimum_low": known.low, "optimum_high": known.high}
