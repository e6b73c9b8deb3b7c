"""The policy with five thresholds, against a slow version of itself and against what it claims."""

from __future__ import annotations

import numpy as np
import pytest

import harness
from harness import policy as policies
from harness.play.evaluation import evaluate
from harness.policy.thresholds import BOUNDS, DEFAULTS, parse
from harness.tuning import tunable
from tests import reference
from tests.test_policies import play_slowly

SURE = "thresholds:accept=0.9,reject=0.1,ahead=1,aside=1"


@pytest.mark.parametrize(
    "given",
    [
        {},
        {"accept": 0.9, "reject": 0.1, "ahead": 1.0, "aside": 1.0},
        {"accept": 0.97, "reject": 0.0, "wait": 0.5},
        {"accept": 0.5, "reject": 0.5, "wait": 0.0},
        {"accept": 1.0, "reject": 0.2, "ahead": 0.5, "aside": 0.95, "wait": 1.0},
    ],
)
def test_it_does_what_its_description_says(rocksample, given):
    slow = play_slowly(lambda: reference.ThresholdsHeuristic(**(DEFAULTS | given)), 2, 150)
    text = ",".join(f"{name}={x}" for name, x in given.items())
    spec = f"thresholds:{text}" if text else "thresholds"
    assert np.array_equal(evaluate(rocksample, spec, episodes=150, seed=2, engine="tables").returns, slow)


def test_reading_on_the_spot_wins_every_good_rock(rocksample):
    """The return is then 10 for the exit and 10 for each good rock, which the initial configuration decides."""
    returns = evaluate(rocksample, SURE, episodes=1000, engine="tables").returns
    configurations = [
        reference.RockSample(harness.engine.rng.uniforms(0, harness.engine.rng.ENGINE, 0, e, 1)[0]) for e in range(1000)
    ]
    assert returns.tolist() == [10 + 10 * sum(world.good) for world in configurations]


def test_it_beats_the_papers_heuristics(rocksample):
    """On the same episodes, discounted and undiscounted, by more than three errors of the difference."""
    ours, *papers = (
        evaluate(rocksample, spec, episodes=10_000, seed=8, engine="tables")
        for spec in ("thresholds", "belief:0.84", "accuracy:0.93")
    )
    for other in papers:
        for difference in (ours.returns - other.returns, ours.discounted - other.discounted):
            assert difference.mean() > 3 * difference.std(ddof=1) / 100


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("acept=0.9", "did you mean 'accept'"),
        ("0.9", "thresholds has no '0.9'"),
        ("accept", "takes a number between 0.5 and 1, not ''"),
        ("accept=x", "not 'x'"),
        ("accept=0.4", "between 0.5 and 1; 0.4 is out of range"),
        ("wait=nan", "nan is out of range"),
        ("accept=0.9,accept=0.8", "given twice"),
        ("accept=0.9,", "has no ''"),
    ],
)
def test_wrong_thresholds_are_explained(rocksample, text, words):
    with pytest.raises(harness.PolicyError, match=words):
        policies.make(f"thresholds:{text}", rocksample)


def test_the_string_of_a_tunable_reads_back_exactly(rocksample):
    subject = tunable("thresholds:wait=0.3", rocksample)
    assert subject.names == tuple(BOUNDS)
    assert dict(zip(subject.names, subject.start, strict=True)) == DEFAULTS | {"wait": 0.3}
    theta = subject.lower + (subject.upper - subject.lower) / np.array([3, 7, 11, 13, 17])
    assert list(parse(subject.text(theta).partition(":")[2]).values()) == theta.tolist()


def test_it_is_listed(rocksample, bordercross):
    assert "thresholds" in policies.specs(rocksample)
    assert "thresholds" not in policies.specs(bordercross)
