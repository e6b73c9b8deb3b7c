"""Solutions as stored: what a solver found for a model, under the hash of that model."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.errors import SnapshotError, quoted
from harness.model import archive
from harness.model.domain import Domain
from harness.model.validation import LARGEST_REWARD, LARGEST_WHOLE, faulty, is_name, outside, whole

KIND = "alpha-vectors"
BOUND_KIND = "bound"
GRAPH_KIND = "policy-graph"
OWN = "solved"
"""What the harness's own solver stores is called by."""
OWN_KINDS = (GRAPH_KIND, KIND)
_BOUND_NUMBERS = ("discounted", "undiscounted", "horizon")
_MEND = "solve it again (harness solve)"


@dataclass(frozen=True)
class Solution:
    """A solved policy or bound as stored: what the solver said, and alpha vectors or a policy graph, or none."""

    record: Mapping[str, Any]
    arrays: Mapping[str, NDArray[Any]]

    @property
    def kind(self) -> str:
        """Of the file that it is stored as: alpha vectors, a policy graph or a bound."""
        if not self.arrays:
            return BOUND_KIND
        return GRAPH_KIND if "edge_node" in self.arrays else KIND


_OWN_MARK = "(harness)"
"""How the names of our own solvers end: their bounds hold after rounding, those of others are as they print them."""


class Bounds(NamedTuple):
    """Proven bounds of the optimal value at the start: discounted, without a horizon."""

    low: float
    high: float


def bounds(record: Mapping[str, Any]) -> Bounds | None:
    """The bounds in a solution's record, where our own solver made it."""
    if not str(record.get("solver", "")).endswith(_OWN_MARK):
        return None
    low, high = record.get("lower"), record.get("upper")
    return Bounds(low, high) if isinstance(low, float) and isinstance(high, float) else None


def save(path: Path, domain: Domain, solution: Solution) -> None:
    """Store a solution together with the model it holds for."""
    about = {
        "domain": domain.name,
        "domain_version": domain.version,
        "model_hash": domain.model_hash,
        "provenance": dict(domain.provenance),
    }
    archive.write(path, solution.kind, {**about, **solution.record}, solution.arrays)


def read(path: Path, domain: Domain, *kinds: str) -> Solution:
    """Read a stored solution of one of the ``kinds``, by default alpha vectors.

    Raises:
        SnapshotError: the file is damaged, was solved for another model, or its vectors do not fit the model.
    """
    record, arrays = archive.read(path, kinds or KIND, _MEND)
    kind = record["kind"]
    _refuse(path, _record_breaches(record, kind))
    if record["model_hash"] != domain.model_hash:
        raise SnapshotError(
            f"{path}: solved for another model ({record['domain']} version {record['domain_version']}, hash "
            f"{record['model_hash'][:12]}…), not for {domain.name} version {domain.version} as it is now "
            f"({domain.model_hash[:12]}…); {_MEND}"
        )
    if kind in _BREACHES:
        _refuse(path, _BREACHES[kind](arrays, domain))
    return Solution(record, arrays)


def _refuse(path: Path, breaches: Iterator[str]) -> None:
    for first in breaches:
        raise SnapshotError(f"{path}: {first}; {_MEND}")


def _record_breaches(record: Mapping[str, Any], kind: str) -> Iterator[str]:
    for name in ("model_hash", "domain"):
        if not is_name(record.get(name)):
            yield f"{name} is {quoted(record.get(name))}, not a printable text"
    if not whole(record.get("domain_version"), 0, LARGEST_WHOLE):
        yield f"domain_version is {quoted(record.get('domain_version'))}, not a whole number"
    for name in _BOUND_NUMBERS if kind == BOUND_KIND else ():
        if not isinstance(record.get(name), (int, float)):
            yield f"{name} is {quoted(record.get(name))}, not a number"


def _vector_breaches(arrays: Mapping[str, NDArray[Any]], domain: Domain) -> Iterator[str]:
    """Alpha vectors whose indices and sizes are the domain's."""
    kinds = {"visible": ("i4", "i8"), "actions": ("i4", "i8"), "values": ("f4", "f8")}
    for name, kind in kinds.items():
        if name not in arrays or arrays[name].dtype not in kind:
            yield f"the array {name} is missing or of another type"
            return
    n = len(arrays["actions"]) if arrays["actions"].ndim else 0
    for name, shape in (("visible", (n,)), ("actions", (n,)), ("values", (n, domain.n_joint))):
        if n < 1 or arrays[name].shape != shape:
            yield f"{name} has the shape {arrays[name].shape}, needed is {shape} with one vector at least"
            return
    yield from outside("visible", arrays["visible"], 0, domain.n_visible)
    yield from outside("actions", arrays["actions"], 0, domain.n_actions)
    yield from faulty("values", ~(np.abs(arrays["values"]) <= LARGEST_REWARD), "is not a finite number")


def _graph_breaches(arrays: Mapping[str, NDArray[Any]], domain: Domain) -> Iterator[str]:
    """A policy graph (:mod:`harness.solver.graph`) whose indices are its own and the domain's."""
    for name in ("action", "first", "edge_visible", "edge_reading", "edge_node", "fallback"):
        if name not in arrays or arrays[name].dtype not in ("i2", "i4", "i8") or arrays[name].ndim != 1:
            yield f"the array {name} is missing, not in one dimension or of another type"
            return
    nodes, edges = len(arrays["action"]), len(arrays["edge_node"])
    sizes = {"first": nodes + 1, "edge_visible": edges, "edge_reading": edges, "fallback": domain.n_visible}
    for name, size in sizes.items():
        if nodes < 1 or len(arrays[name]) != size:
            yield f"{name} has {len(arrays[name])} entries, needed are {size}, and one node at least"
            return
    first = arrays["first"].astype(np.int64)
    if first[0] != 0 or first[-1] != edges or (np.diff(first) < 0).any():
        yield f"first does not rise from 0 to the {edges} edges"
    yield from outside("action", arrays["action"], -1, domain.n_actions)
    yield from outside("edge_node", arrays["edge_node"], 0, nodes)
    yield from outside("edge_visible", arrays["edge_visible"], 0, domain.n_visible)
    yield from outside("edge_reading", arrays["edge_reading"], -1, domain.n_observations)
    yield from outside("fallback", arrays["fallback"], 0, domain.n_actions)


_BREACHES = {KIND: _vector_breaches, GRAPH_KIND: _graph_breaches}
