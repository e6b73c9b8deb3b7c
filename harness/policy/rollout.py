"""The rollout policy: one-step lookahead by simulation, on the policy's own copy of the model."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness.engine.batch import Batch
from harness.model.domain import Domain
from harness.model.tables import Records, Tables, compiled
from harness.policy.base import Stateless
from harness.policy.planner.random_play import random_return, ways_of
from harness.policy.planner.simulating import draw_hidden

SIMULATIONS_DEFAULT = 100


class RolloutPolicy(Stateless):
    """Takes the action with the best mean discounted return over simulations that go on with random legal actions.

    Every simulation draws the hidden part from the belief, applies the action and then plays uniformly over the legal
    actions of the simulated state, as far as the episode's horizon reaches. The n-th simulations of all actions start
    from the same hidden part. Simulations have random numbers of their own, seeded by (seed, step, episode).
    """

    max_episodes = 1000
    """As many episodes does a comparison give it unless told otherwise: it costs thousands of times a heuristic."""
    batch_size = 32
    """Episodes a batch: few, so that progress shows and Ctrl-C is heard between steps."""

    def __init__(self, domain: Domain, simulations: int = SIMULATIONS_DEFAULT, horizon: int = 50) -> None:
        """``simulations`` an action; ``horizon``: steps after which a simulation is cut, counted from now."""
        self.simulations = simulations
        self.horizon = horizon
        self._ways = ways_of(domain)

    def act(self, batch: Batch) -> NDArray[np.int32]:
        """The best action by simulation, for each episode."""
        actions = np.zeros(batch.size, dtype=np.int32)
        seeds = (batch.uniform() * 2.0**53).astype(np.uint64)
        domain = batch.domain
        _rollout_act(
            self._ways, domain.tables, domain.discount, self.simulations, self.horizon, batch.visible, batch.tracked(),
            batch.done, seeds, actions,
        )  # fmt: skip
        return actions


@compiled
def _rollout_act(
    ways: Records,
    t: Tables,
    discount: float,
    simulations: int,
    horizon: int,
    visible: NDArray[np.int32],
    marginals: NDArray[np.float64],
    done: NDArray[np.bool_],
    seeds: NDArray[np.uint64],
    actions: NDArray[np.int32],
) -> None:
    choices, rows, outcomes, n_actions, factor_offset = t.choices, t.rows, t.outcomes, t.n_actions, t.factor_offset
    n_factors = len(factor_offset) - 1
    hidden = np.zeros((1, n_factors), dtype=np.int16)
    values = np.zeros((1, n_factors), dtype=np.int16)
    totals = np.zeros(n_actions)
    state = np.zeros(1, dtype=np.uint64)
    for e in range(len(visible)):
        if done[e]:
            continue
        state[0] = seeds[e]
        totals[:] = 0.0
        for _ in range(simulations):
            draw_hidden(factor_offset, marginals, e, state, hidden)
            for a in range(n_actions):
                for k in range(n_factors):
                    values[0, k] = hidden[0, k]
                totals[a] += random_return(
                    ways, choices, rows, outcomes, n_actions, discount, horizon, visible[e], a, values, state
                )
        best = 0
        for a in range(1, n_actions):
            if totals[a] > totals[best]:
                best = a
        actions[e] = best
