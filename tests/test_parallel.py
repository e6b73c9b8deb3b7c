"""The PettingZoo environment: the harness's episodes, by PettingZoo's rules."""

from __future__ import annotations

import numpy as np
import pytest

import harness
from harness.errors import HarnessError
from harness.model.agents import own_observations
from harness.play.evaluation import evaluate, simulate
from harness.policy.base import Stateless
from harness.policy.team import TeamPolicy

pytest.importorskip("pettingzoo", reason="needs PettingZoo")

from pettingzoo.test import parallel_api_test, parallel_seed_test

from harness.gym.parallel import TeamEnv

HIDDEN = "dec-bordercross-7x8-random"
ROBOTS = ["robot 1", "robot 2"]


class Reacting(Stateless):
    """A rule of the last reading alone, that both the environment's player and a member can follow."""

    uses_belief = False

    def __init__(self, far):
        self.far = far

    def act(self, batch):
        return np.where(batch.observation > 3, self.far, 1)


@pytest.mark.filterwarnings("ignore::UserWarning")  # of agents' names with a blank, and the like
def test_it_passes_pettingzoo_s_own_tests():
    parallel_api_test(TeamEnv(HIDDEN, horizon=12), num_cycles=60)
    parallel_seed_test(lambda: TeamEnv(HIDDEN, horizon=12), num_cycles=30)


@pytest.mark.parametrize("observation", ["reading", "action-reading"])
def test_episodes_are_those_of_evaluate(observation):
    env = TeamEnv(HIDDEN, observation=observation, horizon=9)
    team = TeamPolicy(harness.load(HIDDEN), [Reacting(0), Reacting(2)])
    expected = evaluate(HIDDEN, team, episodes=40, seed=6, horizon=9, engine="tables")
    for k in range(40):
        seen, infos = env.reset(seed=6 if k == 0 else None)
        total = 0.0
        while env.agents:
            readings = [int(seen[robot][-10:].argmax()) for robot in ROBOTS]
            actions = {r: (far if o > 3 else 1) for r, o, far in zip(ROBOTS, readings, (0, 2), strict=True)}
            seen, rewards, ended, cut, infos = env.step(actions)
            assert rewards["robot 1"] == rewards["robot 2"]
            assert (ended["robot 1"] or cut["robot 1"]) == (not env.agents)
            if observation == "action-reading":
                assert {r: int(seen[r][:5].argmax()) for r in ROBOTS} == actions
            total += rewards["robot 1"]
        assert infos["robot 2"]["episode_number"] == k
        assert total == expected.returns[k]


def test_an_agent_is_shown_its_own_reading_and_nothing_else():
    domain = harness.load(HIDDEN)
    env = TeamEnv(domain, observation="reading", horizon=5)
    records = simulate(domain, TeamPolicy(domain, [Reacting(0), Reacting(0)]), "tables", 3, 0, 1, 5)
    own = own_observations(domain, next(records).batch.observation)[:, 0]
    seen, _ = env.reset(seed=3)
    for robot, reading in zip(ROBOTS, own, strict=True):
        assert seen[robot].tolist() == np.eye(10)[reading].tolist()
    assert env.state().shape == env.state_space.shape != env.observation_space("robot 1").shape


def test_misuse_is_explained():
    with pytest.raises(HarnessError, match=r"has no agents: take harness\.gym\.PomdpEnv"):
        TeamEnv("bordercross-7x8")
    with pytest.raises(HarnessError, match="no belief of its own"):
        TeamEnv(HIDDEN, observation="belief")
    env = TeamEnv(HIDDEN, render_mode="ansi")
    with pytest.raises(HarnessError, match="call reset"):
        env.step({})
    env.reset(seed=0)
    assert "1 . . . . . X >" in env.render()
    for actions in ({"robot 1": 0}, {"robot 1": 0, "robot 2": 5}):
        with pytest.raises(HarnessError, match="robot 2 has the actions 0 to 4"):
            env.step(actions)
