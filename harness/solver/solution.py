"""Solutions as stored: what a solver found for a model, under the hash of that model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from harness.errors import SnapshotError
from harness.model import archive
from harness.model.domain import Domain

KIND = "alpha-vectors"
BOUND_KIND = "bound"


@dataclass(frozen=True)
class Solution:
    """A solved policy or bound as stored: what the solver said, and its alpha vectors (none for a bound)."""

    record: Mapping[str, Any]
    arrays: Mapping[str, NDArray[Any]]


def save(path: Path, domain: Domain, solution: Solution) -> None:
    """Store a solution together with the model it holds for."""
    about = {
        "domain": domain.name,
        "domain_version": domain.version,
        "model_hash": domain.model_hash,
        "provenance": dict(domain.provenance),
    }
    kind = KIND if solution.arrays else BOUND_KIND
    archive.write(path, kind, {**about, **solution.record}, solution.arrays)


def read(path: Path, domain: Domain, kind: str = KIND) -> Solution:
    """Read a stored solution.

    Raises:
        SnapshotError: the file is damaged, or was solved for another model.
    """
    record, arrays = archive.read(path, kind)
    if record["model_hash"] != domain.model_hash:
        raise SnapshotError(
            f"{path}: solved for another model ({record['domain']} version {record['domain_version']}, hash "
            f"{record['model_hash'][:12]}…), not for {domain.name} version {domain.version} as it is now "
            f"({domain.model_hash[:12]}…); solve it again (harness solve)"
        )
    return Solution(record, arrays)
