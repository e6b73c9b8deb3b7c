"""Scores of the shipped policies: closed forms, the solver's own bounds, published figures within their error."""

from __future__ import annotations

import pytest

import harness
from harness import registry
from harness.evaluation import evaluate
from harness.policy import alpha


@pytest.fixture(scope="module")
def sarsop(rocksample):
    return evaluate(rocksample, "sarsop", episodes=10_000, engine="tables").score


def test_sarsop_reaches_its_lower_bound_and_the_published_value(rocksample, sarsop):
    record = alpha.read(registry.policy_path("rocksample-7x8", "sarsop"), rocksample).record
    assert record["timeout"] >= 600
    assert sarsop.discounted_mean >= 21.1
    # The lower bound holds for an infinite horizon; 50 steps lose at most a few hundredths.
    assert record["lower"] - 3 * sarsop.discounted_sem - 0.05 <= sarsop.discounted_mean
    assert sarsop.discounted_mean <= record["upper"] + 3 * sarsop.discounted_sem
    assert abs(sarsop.discounted_mean - 21.39) < 3 * sarsop.discounted_sem + 0.1


def test_the_bounds_are_in_order(rocksample):
    paths = {name: registry.policy_path("rocksample-7x8", name) for name in ("sarsop", "qmdp", "mdp")}
    lower = alpha.read(paths["sarsop"], rocksample).record["lower"]
    upper = alpha.read(paths["sarsop"], rocksample).record["upper"]
    qmdp = alpha.read(paths["qmdp"], rocksample).record["initial_value"]
    mdp = alpha.read(paths["mdp"], rocksample, alpha.BOUND_KIND).record
    assert lower <= upper <= qmdp + 1e-3
    assert qmdp <= mdp["discounted"] + 1e-4
    assert mdp["undiscounted"] == pytest.approx(50)  # every good rock (4 on average) and the exit


def test_heuristics_beat_random_and_stay_below_the_bound(rocksample, sarsop):
    scores = {
        spec: evaluate(rocksample, spec, episodes=5000, engine="tables").score
        for spec in ("random", "random-legal", "exit", "qmdp", "accuracy:0.93", "belief:0.84")
    }
    assert scores["random"].mean < scores["random-legal"].mean < scores["accuracy:0.93"].mean
    assert scores["exit"].discounted_mean < scores["qmdp"].discounted_mean < sarsop.discounted_mean
    assert scores["belief:0.84"].discounted_mean < sarsop.discounted_mean
    assert all(score.mean < 50 for score in scores.values())


@pytest.mark.parametrize("policy", ["qmdp", "sarsop"])
def test_bordercross_is_solved_in_twelve_steps(bordercross, policy):
    score = evaluate(bordercross, policy, episodes=200, engine="tables").score
    assert score.mean == 500
    assert score.discounted_mean == pytest.approx(500 * 0.95**11)
    assert score.steps_mean == 12
    assert score.success_rate == 1


def test_the_hidden_robot_costs_something_but_is_found(hidden):
    record = alpha.read(registry.policy_path(hidden.name, "sarsop"), hidden).record
    bound = alpha.read(registry.policy_path(hidden.name, "mdp"), hidden, alpha.BOUND_KIND).record
    score = evaluate(hidden, "sarsop", episodes=5000, engine="tables").score
    # The solver does not know of the reading before the first step, which can only help.
    assert record["lower"] - 3 * score.discounted_sem <= score.discounted_mean
    assert score.discounted_mean <= bound["discounted"] + 3 * score.discounted_sem
    assert score.success_rate > 0.99


def test_a_heuristics_return_by_hand(rocksample):
    """With accuracy 1 demanded no rock away from the robot is ever a candidate, and none lies on the way to the exit."""
    assert evaluate(rocksample, "accuracy:1.0", episodes=50, engine="tables").score.mean == 10


def test_the_undiscounted_score_is_cut_at_the_horizon(rocksample):
    assert evaluate(rocksample, "exit", episodes=10, engine="tables", horizon=6).score.mean == 0
    score = evaluate(rocksample, "exit", episodes=10, engine="tables", horizon=7).score
    assert score.mean == 10
    assert harness.evaluate("rocksample-7x8", "exit", episodes=10, horizon=6, engine="tables").score.success_rate == 0
