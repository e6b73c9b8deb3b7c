"""DESPOT: a determinised sparse tree over scenarios, regularised, searched where its bounds are apart.

Somani, Ye, Hsu and Lee (2013); Ye, Somani, Hsu and Lee (2017, JAIR 58), whose symbols the comments use.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness.engine.batch import Batch
from harness.model.domain import Domain
from harness.model.tables import Records, compiled
from harness.policy.base import fitting
from harness.policy.planner.budget import MOST, Budget, number, parse, whole
from harness.policy.planner.scenarios import Bounds, Tree, back_up, empty_tree, expand, model_and_bounds, plant
from harness.policy.planner.simulating import LONGEST, Model

WORD = "despot"
SCENARIOS, TRIALS, PENALTY = 100, 30, 0.01
MOST_SCENARIOS = 10_000
_SHARE = 0.95  # ξ: a trial leaves so much of the root's gap to the next ones
_CLOSED = 1e-9


class DESPOTPolicy:
    """Determinised sparse partially observable tree: the best small policy for K scenarios drawn from the exact belief.

    A trial goes down by the action of the largest upper bound and the history whose bounds are furthest apart beyond
    its share of ξ = 0.95 of the root's gap, tries all actions in the leaf, and carries the bounds up. The upper bound
    of a scenario is what the fully observed problem is worth there; the lower one what the default policy earns, the
    best one that needs to know nothing hidden (on RockSample: leave). λ is taken off for every history at which a
    policy departs from the default one. The action of the largest lower bound is taken, the default one where none is
    better than that.

    Every step plans anew. Scenarios are seeded by (seed, step, episode), so that neither batches nor threads change an
    action.
    """

    max_episodes = 100
    """As many episodes does a comparison give it unless told otherwise."""
    batch_size = 32
    """Episodes a batch: few, so that progress shows and Ctrl-C is heard between steps."""

    def __init__(
        self,
        domain: Domain,
        scenarios: int = SCENARIOS,
        budget: Budget = Budget(TRIALS),  # noqa: B008 - frozen
        penalty: float = PENALTY,
        depth: int | None = None,
    ) -> None:
        """A planner for a domain.

        Args:
            domain: what it plans for, under the true reward.
            scenarios: K.
            budget: of one action, in trials.
            penalty: λ, in units of discounted reward.
            depth: steps that scenarios reach ahead; by default as far as a reward weighs a hundredth.

        Raises:
            PolicyError: the domain has too many states for the table of the upper bound.
        """
        self.scenarios, self.budget, self.penalty = scenarios, budget, penalty
        self._model, self._bounds = model_and_bounds(domain, depth)

    def reset(self, batch: Batch) -> None:
        """Room for one tree, which every decision uses anew."""
        self._tree = empty_tree(self.scenarios)
        self._size = np.zeros(batch.size)

    def act(self, batch: Batch) -> NDArray[np.int32]:
        """One action an episode."""
        fitting(batch, self._size)
        actions = np.zeros(batch.size, dtype=np.int32)
        seeds = (batch.uniform() * 2.0**53).astype(np.uint64)
        streams = (batch.uniform(1) * 2.0**53).astype(np.uint64)
        marginals, model, bounds, tree = batch.tracked(), self._model, self._bounds, self._tree
        for e in map(int, np.flatnonzero(~batch.done)):
            plant(model, bounds, tree, int(batch.visible[e]), marginals[e], seeds[e], self.penalty)
            for portion in self.budget.portions():
                if not _search(model, bounds, tree, streams[e], portion, self.penalty):
                    break
            actions[e] = _best(tree, model.n_actions, bounds.action)
        return actions


def make(domain: Domain, text: str) -> DESPOTPolicy:
    """The planner of a policy string: ``500``, ``time=100ms``, ``500,trials=1000,lambda=0.1``.

    Raises:
        PolicyError: something in it is unknown or out of range, or the domain is too large.
    """
    found = parse(WORD, text, "scenarios", _SETTINGS)
    milliseconds = found.get("time")
    return DESPOTPolicy(
        domain,
        found.get("scenarios", SCENARIOS),
        Budget(found.get("trials", MOST if milliseconds else TRIALS), milliseconds),
        found.get("lambda", PENALTY),
        found.get("depth"),
    )


_SETTINGS = {
    "scenarios": lambda text: whole(text, MOST_SCENARIOS),
    "trials": lambda text: whole(text, MOST),
    "lambda": lambda text: number(text, 1e9),
    "depth": lambda text: whole(text, LONGEST),
}


@compiled
def _search(m: Model, b: Bounds, tree: Tree, stream: np.uint64, trials: int, penalty: float) -> bool:
    """Make trials; whether more of them could change anything."""
    nodes = tree.nodes
    for _ in range(trials):
        node = _explore(m, b, tree, stream, penalty)
        back_up(tree, m.n_actions, node)
        no_room = nodes[node].edges < 0 and nodes[node].upper > nodes[node].lower
        if no_room or nodes[0].upper - nodes[0].lower <= _CLOSED:
            return False
    return True


@compiled
def _explore(m: Model, b: Bounds, tree: Tree, stream: np.uint64, penalty: float) -> int:
    """One trial; the node at which it ends (Ye et al. 2017, algorithm 3).

    A history at the depth limit, or one that λ rules out, is closed at what the default policy earns there.
    """
    nodes, node, going = tree.nodes, 0, True
    target = _SHARE * (nodes[0].upper - nodes[0].lower) / len(tree.place)
    while going:
        going = nodes[node].depth < m.horizon and not _blocked(nodes, tree.edges, node, penalty)
        if not going:
            nodes[node].lower = nodes[node].upper = nodes[node].default
        if going and nodes[node].edges < 0:
            going = expand(m, b, tree, node, stream, penalty)
            back_up(tree, m.n_actions, node)
        child = _widest(nodes, tree.edges, m.n_actions, node, target) if going else -1
        going = child >= 0
        node = child if going else node
    return node


@compiled
def _widest(nodes: Records, edges: Records, n_actions: int, node: int, target: float) -> int:
    """Under the action of the largest upper bound the history of the largest excess, E > 0; −1 for none."""
    first = nodes[node].edges
    best = first
    for e in range(first, first + n_actions):
        if edges[e].upper > edges[best].upper:
            best = e
    widest, most = -1, 0.0
    for child in range(edges[best].child, edges[best].child + edges[best].children):
        excess = nodes[child].upper - nodes[child].lower - target * nodes[child].count
        if excess > most:
            widest, most = child, excess
    return widest


@compiled
def _blocked(nodes: Records, edges: Records, node: int, penalty: float) -> bool:
    """Whether λ outweighs all that could be gained at a history above, so that none below is worth its place."""
    found, length = False, 1
    while node >= 0:
        found = found or nodes[node].hope - nodes[node].default <= penalty * length
        edge = nodes[node].edge
        node = edges[edge].node if edge >= 0 else -1
        length += 1
    return found


@compiled
def _best(tree: Tree, n_actions: int, default: NDArray[np.int32]) -> int:
    nodes, edges = tree.nodes, tree.edges
    best, most = default[nodes[0].visible], nodes[0].default
    if nodes[0].edges >= 0:
        for a in range(n_actions):
            if edges[nodes[0].edges + a].lower > most:
                best, most = a, edges[nodes[0].edges + a].lower
    return best
