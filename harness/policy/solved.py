"""``solved``: what earns the lower bound of the harness's own solver, stored with the package or solved on the way."""

from __future__ import annotations

import contextlib
import re
from pathlib import Path

from harness import registry
from harness.errors import HarnessError, PolicyError, SnapshotError, quoted
from harness.model import caching
from harness.model.domain import Domain
from harness.policy.alpha import AlphaVectorPolicy
from harness.policy.base import Policy
from harness.policy.graph import PolicyGraph
from harness.solver.solution import GRAPH_KIND, OWN, OWN_KINDS, Solution, read, save

_SECONDS = re.compile(r"([1-9][0-9]{0,3})s")
"""Three hours at most"""


def make(domain: Domain, text: str) -> Policy:
    """The stored policy; with ``10s`` the one that ten seconds of solving find, kept for the next time.

    Raises:
        PolicyError: there is none, or ``text`` is no number of seconds.
        SnapshotError: the stored file is damaged or belongs to another model.
        HarnessError: the domain cannot be solved.
    """
    solution = _on_the_way(domain, text) if text else _stored(domain)
    return (PolicyGraph if solution.kind == GRAPH_KIND else AlphaVectorPolicy)(domain, solution)


def _stored(domain: Domain) -> Solution:
    path = registry.stored_policy(domain, OWN)
    if path is None:
        raise PolicyError(
            f"no solution is stored for {domain.name}; solve it on the way ({OWN}:10s), or once (harness solve "
            f"{domain.name}) and name the file: graph:FILE or alpha:FILE"
        )
    return read(path, domain, *OWN_KINDS)


def _on_the_way(domain: Domain, text: str) -> Solution:
    if not (found := _SECONDS.fullmatch(text)):
        raise PolicyError(f"{OWN} takes a time as 10s, from 1s to 9999s, not {quoted(text)}")
    path = _kept(domain, text)
    if path is not None and path.exists():
        with contextlib.suppress(SnapshotError):  # what is damaged is solved again
            return read(path, domain, *OWN_KINDS)
    from harness.solver import solving

    solution = solving.solve(domain, seconds=float(found[1])).solution
    if path is not None:
        with contextlib.suppress(HarnessError):  # it cannot be written there
            save(path, domain, solution)
    return solution


def _kept(domain: Domain, text: str) -> Path | None:
    """Where the result lies: under the hash of the model that it is for."""
    cache = caching.user_folder()
    return None if cache is None else cache / OWN / f"{domain.model_hash}-{text}.npz"
