"""Finite-state controllers, beside the same policies written out."""

from __future__ import annotations

import numpy as np
import pytest

import harness
from harness.errors import PolicyError

SMALL = {"episodes": 200, "engine": "tables", "horizon": 30}
NODES = 7


def drawn(domain, visible):
    draw = np.random.default_rng(3)
    successors = draw.integers(0, NODES, (NODES, *visible, domain.n_observations))
    return draw.integers(0, domain.n_actions, NODES), successors


class Walk:
    """The controller episode by episode, in plain Python."""

    def __init__(self, actions, successors):
        self.actions, self.successors = actions.tolist(), successors.tolist()

    def reset(self, batch):
        self.nodes = [0] * batch.size

    def act(self, batch):
        if batch.step > 0:
            self.nodes = [self.after(*each) for each in zip(self.nodes, batch.visible, batch.observation, strict=True)]
        return np.array([self.actions[node] for node in self.nodes])

    def after(self, node, visible, reading):
        found = self.successors[node]
        return found[visible][reading] if isinstance(found[0], list) else found[reading]


@pytest.mark.parametrize("by_place", [False, True])
def test_a_controller_walks_its_graph(hidden, by_place):
    actions, successors = drawn(hidden, (hidden.n_visible,) if by_place else ())
    policy = harness.Controller(actions, successors, name="mine")
    found = harness.evaluate(hidden, policy, **SMALL)
    assert len(set(found.returns)) > 5
    assert (found.returns == harness.evaluate(hidden, Walk(actions, successors), **SMALL).returns).all()
    harness.check_policy(policy, hidden, episodes=60)
    assert found.policy == "mine"


@pytest.mark.parametrize(
    ("actions", "successors", "words"),
    [
        ([], [], "has actions"),
        ([[1]], [[0, 0, 0]], "has actions"),
        ([1, 2], [[0, 0, 0]], "has actions"),
        ([1], [[0, 0, 1]], "the nodes are 0 to 0"),
        ([1], [[0, -1, 0]], "the nodes are 0 to 0"),
        ([0.5], [[0, 0, 0]], "whole numbers"),
        ([1], "no", "whole numbers"),
        ([1], [[0, 0]], "have the shape"),
        ([1], [[[0, 0, 0]] * 2], "have the shape"),
        ([13], [[0, 0, 0]], "actions of rocksample-7x8 are 0 to 12"),
    ],
)
def test_what_is_wrong_is_said(rocksample, actions, successors, words):
    with pytest.raises(PolicyError, match=words):
        harness.evaluate(rocksample, harness.Controller(actions, successors), **SMALL)
