"""Belief features and joint beliefs against Bayes' rule over all configurations."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from harness.play.evaluation import simulate
from harness.policy.simple import RandomPolicy
from tests import reference


class Scripted:
    """Plays given actions, one after the other."""

    def __init__(self, actions):
        self.actions = actions

    def reset(self, batch):
        pass

    def act(self, batch):
        return np.full(batch.size, self.actions[batch.step])


@settings(max_examples=60, deadline=None)
@given(
    script=st.lists(st.integers(0, 12), min_size=1, max_size=40),
    seed=st.integers(0, 1000),
)
def test_features_are_the_marginals_over_all_256_configurations(rocksample, script, seed):
    brute, cell = reference.BruteForceBelief(), (1, 4)
    for record in simulate(rocksample, Scripted(script), "tables", seed, 0, 1, len(script)):
        batch = record.batch
        if batch.done[0]:
            break
        if record.actions is not None:
            brute.update(cell, rocksample.actions[record.actions[0]], rocksample.observations[batch.observation[0]])
        cell = tuple(int(x) for x in rocksample.visible_values[batch.visible[0]])
        np.testing.assert_allclose(batch.features[0], brute.features(), atol=1e-12)


def test_equations_1_and_2_to_the_last_bit(rocksample):
    """The tables give the same bits as the equations, written out."""
    script = [rocksample.action("check(3)")] * 12
    right = reference.accuracy((1, 4), reference.ROCKS[2])
    b = 0.5
    for record in simulate(rocksample, Scripted(script), "tables", 1, 0, 1, 12):
        if record.actions is not None:
            wrong = 1 - right
            if rocksample.observations[record.batch.observation[0]] == "good":
                b = right * b / (wrong * (1 - b) + right * b)
            else:
                b = wrong * b / (right * (1 - b) + wrong * b)
        assert record.batch.features[0, 2] == b


def test_joint_belief_is_the_product(rocksample):
    class Tracking(RandomPolicy):
        uses_belief = True

    for record in simulate(rocksample, Tracking(), "tables", 4, 0, 20, 30):
        joint = record.batch.joint()
        assert joint.shape == (20, 256)
        np.testing.assert_allclose(joint.sum(axis=1), 1)
        for i in range(8):  # summing the others out; the last rock varies fastest
            good = (np.arange(256) >> (7 - i)) & 1
            np.testing.assert_allclose(joint @ good, record.batch.features[:, i], atol=1e-12)
    part = record.batch.joint(np.array([3, 7]))
    assert np.array_equal(part, joint[[3, 7]])


def test_hidden_robot_is_located_by_bayes_rule_over_its_cells(hidden):
    """The belief over robot 2's 42 cells against a dictionary of cells updated by hand."""

    class Tracking(RandomPolicy):
        uses_belief = True

    cells = [(row, column) for row in range(1, 8) for column in range(1, 7)]

    def weigh(weights, robot1, reading, ended=False):
        for cell in list(weights):
            weights[cell] *= reference.reading_probabilities(math.dist(robot1, cell))[reading]
        total = sum(weights.values())
        return {cell: weight / total for cell, weight in weights.items()}

    episodes = 15
    beliefs = [dict.fromkeys([(r, c) for r in range(1, 8) for c in range(1, 4)], 1 / 21) for _ in range(episodes)]
    for record in simulate(hidden, Tracking(), "tables", 8, 0, episodes, 40):
        batch = record.batch
        for e in range(episodes):
            if batch.done[e]:
                continue
            robot1 = tuple(int(x) for x in hidden.visible_values[batch.visible[e]])
            if record.actions is not None:
                name = hidden.actions[record.actions[e]]
                if "(2)" in name:
                    moved: dict[tuple[int, int], float] = {}
                    for (row, column), weight in beliefs[e].items():
                        dx, dy = reference.DIRECTIONS[name[: name.index("(")]]
                        to = (row - dy, column + dx)
                        to = to if to in cells else (row, column)
                        moved[to] = moved.get(to, 0) + weight
                    beliefs[e] = moved
                elif name == "cooperate()" and robot1[1] == 6:
                    beliefs[e].pop(robot1, None)  # it did not end, so robot 2 is elsewhere
            beliefs[e] = weigh(beliefs[e], robot1, int(hidden.observations[batch.observation[e]]))
            expected = [beliefs[e].get(cell, 0.0) for cell in cells]
            np.testing.assert_allclose(batch.features[e], expected, atol=1e-12)


def test_nothing_is_hidden_with_a_fixed_start(bordercross):
    record = next(simulate(bordercross, Scripted([0]), "tables", 0, 0, 4, 1))
    assert record.batch.marginals.shape == (4, 0)
    assert np.array_equal(record.batch.joint(), np.ones((4, 1)))


def test_reading_probabilities_of_the_snapshot(bordercross):
    """Each observation distribution of the snapshot is one that the normal CDF gives for some distance."""
    distances = {math.dist((0, 0), (r, c)) for r in range(7) for c in range(6)}
    expected = np.array([reference.reading_probabilities(x) for x in sorted(distances)])
    found = bordercross.tables.reading_probability
    assert len(found) == len(np.unique(np.round(expected, 13), axis=0))
    for row in found:
        assert np.abs(expected - row).max(axis=1).min() < 1e-13
