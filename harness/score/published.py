"""Figures from the literature that stand beside ours. All are discounted returns on the same rules and layouts."""

from __future__ import annotations

from typing import NamedTuple

_SILVER_VENESS = "Silver and Veness 2010, Monte-Carlo Planning in Large POMDPs"


class Published(NamedTuple):
    """A published mean discounted return, with its standard error where one was given."""

    method: str
    """The policy string of ours that it stands beside, or the name of a method that is not run here."""
    value: float
    error: float | None
    source: str


PUBLISHED: dict[str, tuple[Published, ...]] = {
    "rocksample-7x8": (
        Published("rollout", 9.46, None, _SILVER_VENESS),
        Published("sarsop", 21.39, None, _SILVER_VENESS),
        Published("POMCP", 20.71, 0.21, _SILVER_VENESS),
        Published("AEMS2", 21.37, 0.22, _SILVER_VENESS),
        Published("HSVI-BFS", 21.46, 0.22, _SILVER_VENESS),
    ),
}


def reference(domain: str, policy: str) -> Published | None:
    """The published figure for a policy string of ours on a domain, if there is one."""
    word = policy.partition(":")[0]
    return next((entry for entry in PUBLISHED.get(domain, ()) if entry.method == word), None)


def not_run_here(domain: str, policies: list[str]) -> list[Published]:
    """Published figures on a domain for methods that are not among the policies shown."""
    shown = {policy.partition(":")[0] for policy in policies}
    return [entry for entry in PUBLISHED.get(domain, ()) if entry.method not in shown]
