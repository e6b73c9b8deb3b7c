"""How episodes begin: what is visible, and the belief about each hidden factor given that."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.errors import HarnessError
from harness.formats import limits
from harness.formats.network import Network
from harness.formats.rules import Points
from harness.model.indexing import spans


@dataclass(frozen=True, eq=False)
class Start:
    """The initial distribution, and the beliefs that it means."""

    visible: NDArray[np.int64]
    """(starts,)"""
    values: NDArray[np.int64]
    """(starts, K) of the hidden factors."""
    probability: NDArray[np.float64]
    """(starts,)"""
    prior_visible: NDArray[np.int64]
    """(priors,) ascending."""
    prior: NDArray[np.float64]
    """(priors, N) distributions of the factors, one beside the other."""

    def arrays(self, sizes: Sequence[int]) -> dict[str, NDArray[Any]]:
        """The arrays of a domain that tell of the start; there is no first reading."""
        priors = len(self.prior_visible)
        return {
            "start_visible": self.visible, "start_values": self.values, "start_cdf": np.cumsum(self.probability),
            "start_observation": np.full(len(self.visible), -1), "prior_visible": self.prior_visible,
            "prior_marginals": self.prior, "prior_factor": np.full(priors, -1),
            "prior_observation": np.full((priors, max(sizes, default=1)), -1),
        }  # fmt: skip


def visible_starts(network: Network) -> tuple[Points, NDArray[np.float64]]:
    """(n, C) visible values that an episode may begin in, ascending, and their probabilities.

    Raises:
        HarnessError: one depends on a hidden variable; the dependence must be written the other way round.
    """
    functions = [network.start[j] for j in network.visible]
    hidden = {network.columns.before(j) for j in network.hidden}
    for function in functions:
        for column in hidden & set(function.inputs):
            name, parent = network.names(int(function.columns[-1])).name, network.names(column).name
            raise HarnessError(
                f"{network.place(int(function.lines[0]))}: the start of {name}, which is visible, depends on {parent}, "
                f"which is not; let {parent} depend on {name}"
            )
    points, _, weight = network.distributed(functions, np.zeros((1, network.columns.count), dtype=np.int64))
    order = np.lexsort([points[:, network.columns.before(j)] for j in reversed(network.visible)] or [weight])
    return points[order], weight[order]


def start(network: Network, factors: Sequence[Sequence[int]]) -> Start:
    """The start of a model with these factors, each a few state variables."""
    c = network.columns
    points, share = visible_starts(network)
    visible = np.zeros(len(points), dtype=np.int64)
    for j in network.visible:
        visible = visible * len(network.states[j]) + points[:, c.before(j)]
    marginals = [_marginal(network, members, points) for members in factors]
    which, values = _joint(network, marginals, len(points))
    probability = share[which]
    for k, marginal in enumerate(marginals):
        probability = probability * marginal[which, values[:, k]]
    return Start(visible[which], values, probability, visible, np.hstack([np.zeros((len(points), 0)), *marginals]))


def _marginal(network: Network, members: Sequence[int], points: Points) -> NDArray[np.float64]:
    """(n, values of the factor) its distribution at each visible start."""
    sizes = [len(network.states[j]) for j in members]
    there, of, weight = network.distributed([network.start[j] for j in members], points)
    value = np.ravel_multi_index([there[:, network.columns.before(j)] for j in members], sizes)
    table = np.zeros((len(points), int(np.prod(sizes))))
    table[of, value] = weight
    return table


def _joint(
    network: Network, marginals: Sequence[NDArray[np.float64]], n: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """All combinations that are possible: of which visible start, and the factors' values (starts, K)."""
    which, values = np.arange(n), np.zeros((n, 0), dtype=np.int64)
    for marginal in marginals:
        at, value = np.nonzero(marginal)
        count = np.bincount(at, minlength=n)
        first = np.cumsum(count) - count
        what = f"{network.file}: states that an episode may begin in"
        limits.check(what, int(count[which].sum()), limits.LARGEST_COUNT, "let fewer variables be unsure at the start")
        entry, of = spans(first[which], count[which])
        which, values = which[of], np.column_stack([values[of], value[entry]])
    return which, values
