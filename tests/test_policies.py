"""Policies against slow versions of themselves, closed forms, and each other."""

from __future__ import annotations

import numpy as np
import pytest

import harness
from harness import policy as policies
from harness.engine import rng
from harness.play.evaluation import evaluate, simulate
from harness.policy import alpha
from harness.solver import solution as solutions
from tests import reference

HORIZON = 50


def play_slowly(make, seed, episodes):
    """Undiscounted returns of a slow heuristic in the slow domain, with beliefs by eq. 1 and 2."""
    returns = np.zeros(episodes)
    for e in range(episodes):
        world = reference.RockSample(rng.uniforms(seed, rng.ENGINE, 0, e, 1)[0])
        heuristic, beliefs = make(), [0.5] * 8
        for step in range(1, HORIZON + 1):
            if world.done:
                break
            action = heuristic.act(world.cell, world.reading, beliefs)
            cell = world.cell
            returns[e] += world.step(action, rng.uniforms(seed, rng.ENGINE, step, e, 1)[0])
            if action.startswith("check"):
                i = int(action[6:-1]) - 1
                right = reference.accuracy(cell, reference.ROCKS[i])
                like = right if world.reading == "good" else 1 - right
                beliefs[i] = like * beliefs[i] / ((1 - like) * (1 - beliefs[i]) + like * beliefs[i])
            elif action == "sample()":
                beliefs[reference.ROCKS.index(cell)] = 0.0
    return returns


@pytest.mark.parametrize("threshold", [0.5, 0.75, 0.93, 1.0])
def test_accuracy_policy_is_algorithm_2(rocksample, threshold):
    slow = play_slowly(lambda: reference.AccuracyHeuristic(threshold), 2, 150)
    fast = evaluate(rocksample, f"accuracy:{threshold}", episodes=150, seed=2, engine="tables")
    assert np.array_equal(fast.returns, slow)


@pytest.mark.parametrize("threshold", [0.6, 0.84, 0.97, 1.0])
def test_belief_policy_is_algorithm_3(rocksample, threshold):
    slow = play_slowly(lambda: reference.BeliefHeuristic(threshold), 2, 150)
    fast = evaluate(rocksample, f"belief:{threshold}", episodes=150, seed=2, engine="tables")
    assert np.array_equal(fast.returns, slow)


def test_exit_pays_ten_after_seven_steps(rocksample):
    score = evaluate(rocksample, "exit", episodes=20, engine="tables").score
    assert score.mean == 10
    assert score.sem == 0
    assert score.discounted_mean == pytest.approx(10 * 0.95**6, abs=1e-14)
    assert score.discounted_sem == 0
    assert score.steps_mean == 7
    assert score.success_rate == 1


def test_random_draws_every_action_equally_often(rocksample):
    counts = np.zeros(rocksample.n_actions)
    for record in simulate(rocksample, policies.make("random", rocksample)[1], "tables", 0, 0, 5000, 4):
        if record.actions is not None:
            counts += np.bincount(record.actions, minlength=rocksample.n_actions)
    expected = counts.sum() / len(counts)
    assert (np.abs(counts - expected) < 5 * np.sqrt(expected)).all()


def test_random_legal_is_uniform_over_the_legal_actions(rocksample):
    made = policies.make("random-legal", rocksample)[1]
    record = next(simulate(rocksample, made, "tables", 0, 0, 20_000, 1))
    legal = record.batch.legal()[0]
    assert [rocksample.actions[a] for a in np.flatnonzero(~legal)] == ["left()"]  # at (1, 4)
    counts = np.bincount(made.act(record.batch), minlength=13)
    assert counts[~legal].sum() == 0
    expected = 20_000 / legal.sum()
    assert (np.abs(counts[legal] - expected) < 5 * np.sqrt(expected)).all()


@pytest.mark.parametrize("name", ["rocksample-7x8", "bordercross-7x8", "bordercross-7x8-random"])
def test_random_legal_never_pays_the_penalty(name):
    domain = harness.load(name)
    for record in simulate(domain, policies.make("random-legal", domain)[1], "tables", 1, 0, 500, HORIZON):
        assert record.rewards.min() >= -10


def test_rollout_prefers_what_pays_at_once(rocksample):
    """On a rock that is surely good, one step of lookahead samples it; before the exit with nothing left, it leaves."""

    class OnRock2:
        """Walks to rock 2 at (1, 2), checks it (a sure reading there) and asks the rollout policy."""

        def __init__(self):
            self.rollout = policies.make("rollout:200", rocksample)[1]
            self.answers = None

        def reset(self, batch):
            self.rollout.reset(batch)

        def act(self, batch):
            plan = ["down()", "down()", "check(2)"]
            if batch.step < 3:
                return np.full(batch.size, rocksample.action(plan[batch.step]))
            if batch.step == 3:
                answers.append((batch.features[:, 1].copy(), self.rollout.act(batch)))
            return np.full(batch.size, rocksample.action("right()"))

    answers: list = []
    list(simulate(rocksample, OnRock2(), "tables", 0, 0, 60, 4))
    belief, action = answers[0]
    assert set(belief) == {0.0, 1.0}
    assert (action[belief == 1] == rocksample.action("sample()")).all()
    assert (action[belief == 0] != rocksample.action("sample()")).all()


def test_rollout_does_not_depend_on_the_batch(rocksample, monkeypatch):
    whole = evaluate(rocksample, "rollout:4", episodes=40, engine="tables")
    monkeypatch.setattr("harness.policy.rollout.RolloutPolicy.batch_size", 7)
    split = evaluate(rocksample, "rollout:4", episodes=40, engine="tables", workers=2)
    assert np.array_equal(whole.returns, split.returns)


def test_alpha_vectors_slowly(rocksample):
    """Grouped matrix products choose what the definition of an alpha-vector policy says, belief by belief."""
    solution = solutions.read(harness.registry.policy_path("rocksample-7x8", "sarsop"), rocksample)
    made = alpha.AlphaVectorPolicy(rocksample, solution)
    visible, actions = solution.arrays["visible"], solution.arrays["actions"]
    values = solution.arrays["values"].astype(float)
    compared = 0
    for record in simulate(rocksample, made, "tables", 5, 0, 30, 12):
        chosen = made.act(record.batch)
        for e in np.flatnonzero(~record.batch.done):
            joint = np.ones(1)
            for p in record.batch.features[e]:
                joint = np.concatenate([[w * (1 - p), w * p] for w in joint])
            rows = np.flatnonzero(visible == record.batch.visible[e])
            scores = [float(np.dot(values[i], joint)) for i in rows]
            best = max(scores)
            assert chosen[e] in {actions[i] for i, s in zip(rows, scores, strict=True) if s > best - 1e-6}
            compared += 1
    assert compared > 100


def test_equal_alpha_vectors_go_to_the_first(bordercross):
    n = bordercross.n_visible
    arrays = {
        "visible": np.repeat(np.arange(n), 2).astype(np.int32),
        "actions": np.tile([3, 5], n).astype(np.int32),
        "values": np.tile(np.array([[1.0], [1.0 + 1e-12]]), (n, 1)),
    }
    made = alpha.AlphaVectorPolicy(bordercross, solutions.Solution({}, arrays))
    record = next(simulate(bordercross, made, "tables", 0, 0, 5, 1))
    assert (made.act(record.batch) == 3).all()


class TestUsersOwnPolicies:
    def test_any_object_with_reset_and_act(self, rocksample):
        class CheckThenLeave:
            name = "check then leave"

            def reset(self, batch):
                self.left = np.zeros(batch.size, dtype=int)

            def act(self, batch):
                self.left += 1
                return np.where(self.left <= 2, batch.domain.action("check(3)"), batch.domain.action("right()"))

        result = evaluate(rocksample, CheckThenLeave(), episodes=9000, engine="tables", workers=2)
        assert result.policy == "check then leave"
        assert (result.returns == 10).all()
        assert (result.steps == 9).all()
        np.testing.assert_allclose(result.discounted, 10 * 0.95**8)

    @pytest.mark.parametrize(
        ("answer", "words"),
        [
            (lambda e: np.zeros(e), "whole numbers"),
            (lambda e: np.zeros((e, 1), dtype=int), "shape"),
            (lambda e: np.full(e, 13), "action 13"),
            (lambda e: np.full(e, -2), "action -2"),
            (lambda e: None, "whole numbers"),
        ],
    )
    def test_what_is_no_action_is_refused(self, rocksample, answer, words):
        class Wrong:
            def reset(self, batch):
                pass

            def act(self, batch):
                return answer(batch.size)

        with pytest.raises(harness.PolicyError, match=words):
            evaluate(rocksample, Wrong(), episodes=5, engine="tables")

    def test_what_is_no_policy_is_refused(self, rocksample):
        for thing in (object(), 3, policies.AccuracyPolicy):  # a class is not an object of it
            with pytest.raises(harness.PolicyError, match=r"reset\(batch\) and act\(batch\)"):
                evaluate(rocksample, thing, engine="tables")

    @pytest.mark.parametrize("wrong", [{"episodes": 0}, {"horizon": 0}, {"seed": -1}, {"seed": 2**64}])
    def test_counts_out_of_range_are_refused(self, rocksample, wrong):
        with pytest.raises(harness.HarnessError, match=next(iter(wrong))):
            evaluate(rocksample, "exit", engine="tables", **wrong)


class TestPolicyStrings:
    def test_defaults_are_filled_in(self, rocksample):
        assert policies.make("accuracy", rocksample)[0] == "accuracy:0.93"
        assert policies.make("belief", rocksample)[0] == "belief:0.84"

    @pytest.mark.parametrize(
        ("spec", "words"),
        [
            ("sarsp", "did you mean 'sarsop'"),
            ("nothing-like-it", "on rocksample-7x8: random, random-legal, exit"),
            ("belief:1.2", "between 0.5 and 1; 1.2 is out of range"),
            ("belief:x", "not 'x'"),
            ("belief:nan", "out of range"),
            ("accuracy:0.4", "out of range"),
            ("random:3", "takes no parameter"),
            ("rollout:0", "from 1 to 1,000,000"),
            ("rollout:1000001", "from 1 to 1,000,000"),
            ("rollout:" + "9" * 5000, "from 1 to 1,000,000"),
            ("program:a\0b", "cannot read"),
            ("program:" + "x" * 5000, "cannot read"),
            ("alpha", "alpha:FILE"),
            ("alpha:none.npz", "none.npz: no such file"),
        ],
    )
    def test_wrong_ones_are_explained(self, rocksample, spec, words):
        with pytest.raises(harness.HarnessError, match=words):
            policies.make(spec, rocksample)

    def test_rocksample_heuristics_need_rocks(self, bordercross):
        with pytest.raises(harness.PolicyError, match="needs a rocksample domain"):
            policies.make("belief", bordercross)

    def test_every_default_can_be_made(self):
        for name in harness.names():
            domain = harness.load(name)
            for spec in policies.default_specs(domain):
                assert policies.make(spec, domain)[0] == spec
