"""Agents that learned elsewhere, as policies."""

from __future__ import annotations

import time

import numpy as np
import pytest

import harness
from harness.errors import HarnessError, PolicyError
from harness.policy.agent import drawn
from harness.policy.encoding import KINDS, Encoding

SMALL = {"episodes": 40, "engine": "tables", "horizon": 25}


def weights(domain, kind):
    return np.random.default_rng(2).integers(-9, 10, (Encoding(kind, domain).size, domain.n_actions)).astype(float)


class Remembering:
    """An agent of Stable-Baselines3's kind: the sum of all that it saw in the episode, rounded, decides."""

    def __init__(self, w):
        self.w = w

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        assert deterministic
        seen = np.round(observation * 8)
        state = seen + (0 if state is None else np.where(episode_start[:, None], 0, state))
        return (state @ self.w).argmax(axis=1), state


class Told:
    """The same, written out as a policy."""

    def __init__(self, w, kind):
        self.w, self.kind = w, kind

    def reset(self, batch):
        self.sum, self.last = 0, np.full(batch.size, -1, dtype=np.int32)

    def act(self, batch):
        self.sum = self.sum + np.round(Encoding(self.kind, batch.domain)(batch, self.last) * 8)
        self.last = (self.sum @ self.w).argmax(axis=1).astype(np.int32)
        return self.last


@pytest.mark.parametrize("kind", KINDS)
def test_an_agent_with_a_memory_is_a_policy(rocksample, kind):
    w = weights(rocksample, kind)
    policy = harness.AgentPolicy(Remembering(w), observation=kind, name="mine")
    found = harness.evaluate(rocksample, policy, **SMALL)
    assert (found.returns == harness.evaluate(rocksample, Told(w, kind), **SMALL).returns).all()
    harness.check_policy(policy, rocksample, episodes=60)
    assert harness.compare(rocksample, [policy, "exit"], **SMALL)["policy"].tolist() == ["mine", "exit"]


class Alone(Remembering):
    """One that writes to itself while it predicts, as Stable-Baselines3's do."""

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        self.seen = observation
        time.sleep(0.001)
        return super().predict(self.seen, state, episode_start, deterministic)


def test_an_agent_predicts_for_one_thread_at_a_time(rocksample):
    harness.check_policy(harness.AgentPolicy(Alone(weights(rocksample, "belief"))), rocksample, episodes=60)


def test_an_agent_has_its_replays_and_its_path(rocksample, tmp_path):
    """By a file, as the commands and the report take it."""
    w = weights(rocksample, "reading")
    policy = harness.AgentPolicy(Remembering(w), observation="reading")
    played = harness.evaluate(rocksample, policy, **SMALL)
    last = list(harness.replay(rocksample, policy, episode=3, engine="tables", horizon=25))[-1]
    assert f"return {played.returns[3]:g}," in last
    file = tmp_path / "agent.py"
    file.write_text("""import harness
from tests.test_agents import Remembering, weights
def mine(domain):
    return harness.AgentPolicy(Remembering(weights(domain, "reading")), observation="reading")
""")
    assert (harness.evaluate(rocksample, f"{file}:mine", **SMALL).returns == played.returns).all()


def test_an_encoding_is_what_it_says(rocksample, hidden):
    """By hand, of episodes that went a step."""
    for domain in (rocksample, hidden):
        batch = after_two_steps(domain)
        last = np.array([3, -1], dtype=np.int32)
        place = [places(domain, name, batch.visible) for name in domain.visible_names]
        read = np.eye(domain.n_observations)[batch.observation]
        did = np.eye(domain.n_actions)[last] * (last >= 0)[:, None]
        shown = {"belief": [batch.features], "marginals": [batch.marginals], "reading": [read]}
        for kind, parts in (shown | {"action-reading": [did, read]}).items():
            encoding = Encoding(kind, domain)
            found = encoding(batch, last)
            assert np.allclose(found, np.hstack([*parts, *place]), atol=1e-7)
            assert found.shape[1] == encoding.size == len(encoding.names)


def places(domain, name, visible):
    """One-hot, in the order of the values."""
    column = domain.visible_values[:, domain.visible_names.index(name)].tolist()
    return [[column[v] == value for value in sorted(set(column))] for v in visible]


def after_two_steps(domain):
    batches = []

    class Checks:
        def reset(self, batch):
            pass

        def act(self, batch):
            batches.append(batch)
            return np.full(batch.size, domain.n_actions - 1)

    harness.evaluate(domain, Checks(), episodes=2, horizon=2, engine="tables", workers=1)
    return batches[-1]


class Masked(Remembering):
    def predict(self, observation, state=None, episode_start=None, deterministic=False, action_masks=None):
        return np.where(action_masks, observation @ self.w, -np.inf).argmax(axis=1), None


@pytest.mark.parametrize("legal", [False, True])
def test_logits_are_masked_if_asked(hidden, legal):
    """On a domain where the belief decides what is legal."""
    w = weights(hidden, "belief")
    policy = harness.LogitsPolicy(lambda seen: seen @ w, legal=legal)
    found = harness.evaluate(hidden, policy, **SMALL)
    if legal:
        agent = harness.AgentPolicy(Masked(w), legal=True)
        assert (found.returns == harness.evaluate(hidden, agent, **SMALL).returns).all()
    watched = Watched(policy)
    harness.evaluate(hidden, watched, **SMALL, workers=1)
    assert all(watched.were_legal) == legal


class Watched:
    """A policy, and whether all its actions of a step were legal."""

    def __init__(self, policy):
        self.policy, self.were_legal = policy, []
        self.reset = policy.reset

    def __deepcopy__(self, memo):
        made = Watched(self.policy)
        made.were_legal = self.were_legal
        return made

    def act(self, batch):
        actions = self.policy.act(batch)
        chosen = batch.legal()[np.arange(batch.size), actions]
        self.were_legal.append(bool(chosen[~batch.done].all()))
        return actions


def test_draws_follow_the_softmax_and_never_what_is_left_out():
    logits = np.tile([0.0, -np.inf, np.log(3.0), -np.inf], (4000, 1))
    u = (np.arange(4000) + 0.5) / 4000
    assert np.bincount(drawn(logits, u), minlength=4).tolist() == [1000, 0, 3000, 0]
    assert drawn(logits[:2], np.array([0.0, np.nextafter(1, 0)])).tolist() == [0, 2]


def test_a_drawn_policy_scores_the_same_however_it_is_cut(rocksample):
    w = weights(rocksample, "reading")
    policy = harness.LogitsPolicy(lambda seen: np.round(seen * 8) @ w, observation="reading", deterministic=False)
    harness.check_policy(policy, rocksample, episodes=60)


def test_what_is_wrong_is_said(rocksample):
    with pytest.raises(HarnessError, match="did you mean 'belief'"):
        harness.AgentPolicy(Remembering(0), observation="beleif")
    with pytest.raises(PolicyError, match=r"logits of shape \(40, 13\), not \(40, 2\)"):
        harness.evaluate(rocksample, harness.LogitsPolicy(lambda seen: seen[:, :2]), **SMALL)
    agent = Remembering(weights(rocksample, "belief"))
    agent.observation_space = np.zeros(7)
    with pytest.raises(PolicyError, match="trained on observations of shape"):
        harness.evaluate(rocksample, harness.AgentPolicy(agent), **SMALL)


class TestTorch:
    """Modules, plain and recurrent."""

    def test_modules_play_as_their_logits_say(self, rocksample):
        torch = pytest.importorskip("torch", reason="needs PyTorch")
        w = weights(rocksample, "belief")
        plain = torch.nn.Sequential(torch.nn.Dropout(), torch.nn.Linear(*w.shape, bias=False))
        plain[1].weight.data = torch.tensor(w.T, dtype=torch.float32)
        found = harness.evaluate(rocksample, harness.LogitsPolicy(plain), **SMALL)
        by_hand = harness.LogitsPolicy(lambda seen: seen @ w)
        assert (found.returns == harness.evaluate(rocksample, by_hand, **SMALL).returns).all()
        assert plain.training  # what was given stays as it was

    def test_a_recurrent_one_keeps_its_state(self, rocksample):
        torch = pytest.importorskip("torch", reason="needs PyTorch")
        w = torch.tensor(weights(rocksample, "reading"))

        class Sums(torch.nn.Module):
            def __init__(self):
                super().__init__()
                self.w = torch.nn.Parameter(w)

            def forward(self, seen, state=None):
                state = torch.round(seen * 8) + (0 if state is None else state)
                return state @ self.w, state

        policy = harness.LogitsPolicy(Sums(), observation="reading")
        found = harness.evaluate(rocksample, policy, **SMALL)
        assert (found.returns == harness.evaluate(rocksample, Told(w.numpy(), "reading"), **SMALL).returns).all()
