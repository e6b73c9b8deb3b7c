"""Fitness for other people's optimisers: the returns of evaluate, on the episodes kept for searches."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import harness
from harness.engine import rng
from harness.errors import HarnessError
from harness.ge.defaults import grammar_for
from harness.ge.mapping import derive
from harness.policy.program import ProgramPolicy
from harness.program import parse, words_of

TEXTS = ["right()", "check(4)\nif(belief(4) > 0.6) right()", "no program(", "loop right()", "sample()"]


def wanted(domain, policy, first=0):
    played = {"episodes": 30, "seed": rng.TRAINING + 5, "horizon": 20, "engine": "tables"}
    return harness.evaluate(domain, policy, first=first, **played).returns


@pytest.fixture
def small():
    return {"episodes": 30, "seed": 5, "horizon": 20}


@pytest.mark.parametrize("first", [0, 30])
def test_programs_return_what_evaluate_says(rocksample, small, first):
    evaluate = harness.Evaluator("rocksample-7x8", **small)
    returns = evaluate.returns(TEXTS, first=first)
    for text, row in zip(TEXTS, returns, strict=True):
        if text == "no program(":
            assert (row == -np.inf).all()
            assert "line 1, column 1" in evaluate.fault(text)
        else:
            policy = ProgramPolicy(parse(text, words_of(rocksample)))
            assert (row == wanted(rocksample, policy, first)).all()
            assert evaluate.fault(text) is None
    assert (evaluate(TEXTS, first=first) == returns.mean(axis=1)).all()


def test_codons_are_mapped_as_evolve_maps_them(rocksample, small):
    evaluate = harness.Evaluator(rocksample, "rocksample", **small)
    codons = np.random.default_rng(0).integers(0, 256, (60, 6))
    texts = [derive(grammar_for(rocksample, "rocksample"), row.astype(np.int32)).phenotype for row in codons]
    ended = np.array([text is not None for text in texts])
    assert 0 < ended.sum() < 60
    assert (evaluate.returns(codons)[~ended] == -np.inf).all()
    programs = harness.Evaluator(rocksample, **small)
    assert (evaluate.returns(codons)[ended] == programs.returns([text for text in texts if text])).all()
    assert (evaluate(codons.astype(float)) == evaluate([list(row) for row in codons])).all()
    assert "does not end" in evaluate.fault(codons[~ended][0])


def test_policies_return_what_evaluate_says(rocksample, small):
    """A finite-state controller among programs."""
    policy = harness.Controller([11, 1, 4], [[1, 1, 2], [1, 1, 1], [1, 1, 1]])
    evaluate = harness.Evaluator(rocksample, **small)
    returns = evaluate.returns(["right()", policy, "no program("], first=30)
    assert (returns[1] == wanted(rocksample, policy, 30)).all()
    assert (returns[0] == evaluate.returns(["right()"], first=30)[0]).all()
    assert (returns[2] == -np.inf).all()
    assert evaluate.text(policy) == "controller"
    assert evaluate.fault(policy) is None


def test_vectors_play_a_tunable_policy(rocksample, small):
    evaluate = harness.Evaluator(rocksample, policy="thresholds", **small)
    points = [evaluate.subject.start, [0.9, 0.2, 0.9, 0.7, 0.8]]
    for point, row in zip(points, evaluate.returns(points), strict=True):
        assert (row == wanted(rocksample, evaluate.text(point))).all()
    program = harness.Evaluator(rocksample, policy="check(4)\nif(belief(4) > 0.6) right()\n", **small)
    assert program.text([0.3]) == "check(4)\nif(belief(4) > 0.3) right()\n"
    assert (program.returns([[0.6]])[0] == harness.Evaluator(rocksample, **small).returns([TEXTS[1]])[0]).all()


@pytest.mark.parametrize(
    ("kwargs", "candidates"),
    [({}, TEXTS), ({"grammar": "rocksample"}, [[3, 1, 4], [1] * 30]), ({"policy": "belief"}, [[0.8]])],
)
def test_it_can_be_sent_elsewhere(small, kwargs, candidates):
    evaluate = harness.Evaluator("rocksample-7x8", **kwargs, **small)
    there = pickle.loads(pickle.dumps(evaluate))
    assert (there.returns(candidates) == evaluate.returns(candidates)).all()
    assert len(evaluate.returns([])) == 0


@pytest.mark.parametrize(
    ("kwargs", "candidates", "words"),
    [
        ({}, "right()", r"give \[text\]"),
        ({}, [[1, 2]], "without a grammar codons mean nothing"),
        ({"grammar": "rocksample"}, [[1, -2]], "codons must be whole numbers"),
        ({"grammar": "rocksample"}, [[1, 0.5]], "codons must be whole numbers"),
        ({"policy": "belief"}, [[0.8, 0.9]], "vectors of 1 numbers"),
        ({"policy": "belief"}, [[1.8]], "out of the bounds"),
        ({"policy": "belief"}, [[float("nan")]], "out of the bounds"),
        ({"policy": "belief", "grammar": "rocksample"}, [], "not both"),
        ({"policy": "exit"}, [], "has no numbers to tune"),
        ({"seed": 2**61}, [], "seed"),
    ],
)
def test_what_is_wrong_is_said(small, kwargs, candidates, words):
    with pytest.raises(HarnessError, match=words):
        harness.Evaluator("rocksample-7x8", **(small | kwargs))(candidates)
