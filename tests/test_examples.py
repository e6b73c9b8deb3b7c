"""The examples run, where the library that they are of is installed."""

from __future__ import annotations

import asyncio
import runpy
from pathlib import Path

import numpy as np
import pytest

import harness
from harness.engine import rng
from tests import models

EXAMPLES = Path(__file__).parent.parent / "examples"
PROGRAM = "# EVOLVE-BLOCK-START\nloop right()\n# EVOLVE-BLOCK-END\n"


def run(name):
    return runpy.run_path(str(EXAMPLES / f"{name}.py"))


@pytest.mark.filterwarnings("ignore")  # of the libraries' own
def test_deap_evolves_codons():
    pytest.importorskip("deap", reason="needs DEAP")
    program, fitness = run("deap_codons")["main"](population=20, generations=2, episodes=20)
    assert harness.Evaluator("rocksample-7x8", episodes=20)([program]) == [fitness]


@pytest.mark.filterwarnings("ignore")
def test_ribs_fills_an_archive():
    pytest.importorskip("ribs", reason="needs pyribs")
    evaluate, archive = run("ribs_thresholds")["main"](iterations=2, batch=5, episodes=20)
    assert 0 < len(archive) <= 10
    for elite in archive:
        assert evaluate([elite["solution"]])[0] == pytest.approx(elite["objective"])


@pytest.mark.filterwarnings("ignore")
def test_optuna_studies_thresholds():
    pytest.importorskip("optuna", reason="needs Optuna")
    policy, value = run("optuna_thresholds")["main"](trials=3, episodes=20)
    theta = [float(part.split("=")[1]) for part in policy.partition(":")[2].split(",")]
    assert harness.Evaluator("rocksample-7x8", policy="thresholds", episodes=80)([theta])[0] == pytest.approx(value)


@pytest.mark.filterwarnings("ignore")
def test_paynt_s_controller_earns_what_paynt_says(tmp_path):
    pytest.importorskip("paynt", reason="needs PAYNT")
    model = tmp_path / "tiger.pomdp"
    harness.write_model(models.tiger(), model)
    value, controller = run("paynt_controller")["main"](model, seconds=3.0, folder=tmp_path)
    found = harness.exact(str(model), f"fsc:{controller}", horizon=600)
    assert found.discounted.low == pytest.approx(value, rel=1e-3)


def test_the_function_for_openevolve_scores_programs_and_says_what_is_wrong(tmp_path):
    evaluate = run("openevolve_evaluator")["evaluate"]
    (tmp_path / "good.txt").write_text(PROGRAM)
    (tmp_path / "bad.txt").write_text("def policy():")
    assert evaluate(str(tmp_path / "good.txt")) == {
        "combined_score": 10.0,
        "sem": 0.0,
        "worst_tenth": 10.0,
        "valid": 1.0,
    }
    refused = evaluate(str(tmp_path / "bad.txt"))
    assert (refused["combined_score"], refused["valid"]) == (-100.0, 0.0)
    assert "line 1" in refused["error"]


@pytest.mark.filterwarnings("ignore")
def test_openevolve_takes_it():
    evaluator = pytest.importorskip("openevolve.evaluator", reason="needs OpenEvolve")
    config = pytest.importorskip("openevolve.config").EvaluatorConfig(cascade_evaluation=False)
    judge = evaluator.Evaluator(config, str(EXAMPLES / "openevolve_evaluator.py"), suffix=".txt")
    found = asyncio.run(judge.evaluate_program(PROGRAM, "p"))
    assert found["combined_score"] == 10.0
    assert np.isfinite(found["sem"])


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("kind", ["recurrent", "masked"])
def test_agents_are_trained_and_play(kind, rocksample):
    """On the episodes of nobody's evaluation; what comes out acts alike in every batch, and legally if it is masked."""
    pytest.importorskip("sb3_contrib", reason="needs sb3-contrib")
    example = run("reinforcement_learning")
    model, curve = example["train"](kind, 800, lanes=8, every=400, episodes=20)
    assert [steps for steps, _ in curve] == [0, 400]
    assert (model.env.env._parts[0].lanes.seed >= rng.TRAINING).all()
    policy = example["policy_of"](kind, model)
    harness.check_policy(policy, rocksample, episodes=40)
    if kind == "masked":
        assert harness.evaluate(rocksample, policy, episodes=50, engine="tables").returns.min() > -100
