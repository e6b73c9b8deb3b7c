"""What one agent of a Dec-POMDP knows of it: its own actions and readings, and whether the episode has ended."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from harness.model.domain import ARRAYS, Domain
from harness.model.indexing import strides

GOING, OVER = range(2)
"""Visible values of a local view."""


@functools.lru_cache(maxsize=16)
def local_view(domain: Domain, agent: int) -> Domain:
    """The domain as one of its agents sees it: the words that its policy may use.

    Its actions and observations are the agent's own, nothing is visible but whether the episode goes on
    (:data:`GOING`) or has ended (:data:`OVER`), and nothing is hidden. What happens depends on the other agents too, so
    that a view has no dynamics of its own: its arrays say that nothing ever happens. Policies are written for it, and
    it is not for playing.

    Args:
        domain: with agents.
        agent: its index.
    """
    own = domain.agents[agent]
    return replace(
        domain,
        name=f"{own.name} of {domain.name}",
        title=f"what {own.name} sees of {domain.title}",
        n_states=2,
        actions=own.actions,
        observations=own.observations,
        visible_names=(),
        factors=(),
        factor_labels=(),
        features=(),
        shapings=("none",),
        shaping="none",
        arrays=_nothing_happens(len(own.actions), len(own.observations)),
        live=None,
        sensors=(),
        agents=(),
    )


def own_observations(domain: Domain, observations: NDArray[np.int32]) -> NDArray[np.int32]:
    """(n, …) what each agent reads where all together read ``observations`` (…); −1 where there is no reading."""
    sizes = [len(agent.observations) for agent in domain.agents]
    axes = (-1, *[1] * observations.ndim)
    own = observations // strides(sizes).reshape(axes) % np.array(sizes).reshape(axes)
    return np.where(observations < 0, -1, own).astype(np.int32)


def action_strides(domain: Domain) -> NDArray[np.int64]:
    """(n,) by how much the index of what all do grows with the index of each agent's own action."""
    return strides([len(agent.actions) for agent in domain.agents])


def _nothing_happens(actions: int, observations: int) -> dict[str, NDArray[np.generic]]:
    ones, none = np.ones(actions), np.zeros(actions)
    uniform = np.full((1, observations), 1 / observations)
    arrays = {
        "first_row": [*range(actions), *[-1] * actions], "factor": np.full(2 * actions, -1), "terminal": [False, True],
        "legal": ones, "row_outcomes": np.arange(actions + 1), "outcome_visible": none, "outcome_value": none,
        "outcome_probability": ones, "outcome_cdf": ones, "outcome_observation": none, "outcome_reward": none[None],
        "observation_probability": uniform, "observation_cdf": np.cumsum(uniform, axis=1),
        "start_visible": [GOING], "start_values": np.empty((1, 0)), "start_cdf": [1.0], "start_observation": [0],
        "prior_visible": [GOING], "prior_marginals": np.empty((1, 0)), "prior_factor": [-1],
        "prior_observation": [[-1]], "visible_values": np.empty((2, 0)),
    }  # fmt: skip
    return {name: np.ascontiguousarray(arrays[name], dtype=dtype) for name, dtype in ARRAYS.items()}
