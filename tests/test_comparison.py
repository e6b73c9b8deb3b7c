"""The comparison table, for people and for programs."""

from __future__ import annotations

import io
import json

import numpy as np
import pandas as pd
import pytest

import harness
from harness.score import comparison

REQUIRED = [
    *("domain", "policy", "engine", "episodes", "seed", "mean", "sem", "ci_low", "ci_high"),
    *("discounted_mean", "discounted_sem", "steps_mean", "success_rate", "reference"),
]


@pytest.fixture(scope="module")
def table():
    return harness.compare("rocksample-7x8", ["exit", "belief:0.84", "sarsop", "mdp"], episodes=400, engine="tables")


def test_rows_have_what_programs_need(table):
    assert set(REQUIRED) <= set(table.columns)
    assert table["policy"].tolist() == ["exit", "belief:0.84", "sarsop", "mdp"]
    assert table["kind"].tolist() == ["policy"] * 3 + ["upper bound"]


def test_the_score_is_the_mean_of_the_episodes(table):
    returns = harness.evaluate("rocksample-7x8", "belief:0.84", episodes=400, engine="tables").returns
    row = table.set_index("policy").loc["belief:0.84"]
    assert row["mean"] == pytest.approx(np.mean(returns))
    assert row["sem"] == pytest.approx(np.std(returns, ddof=1) / 20)
    assert row["ci_low"] == pytest.approx(row["mean"] - 1.96 * row["sem"], abs=1e-3)
    assert row["ci_high"] == pytest.approx(row["mean"] + 1.96 * row["sem"], abs=1e-3)


def test_json_is_a_list_of_rows(table):
    rows = json.loads(comparison.render(table, "json"))
    assert [r["policy"] for r in rows] == table["policy"].tolist()
    assert rows[2]["reference"]["discounted_mean"] == 21.39
    assert "Silver" in rows[2]["reference"]["source"]
    assert rows[0]["reference"] is None
    assert rows[3]["episodes"] is None
    assert all(set(REQUIRED) <= set(r) for r in rows)


def test_csv_opens_in_pandas(table):
    back = pd.read_csv(io.StringIO(comparison.render(table, "csv")))
    np.testing.assert_allclose(back["mean"], table["mean"].astype(float))


@pytest.mark.parametrize("style", ["table", "markdown"])
def test_text_shows_every_policy_and_the_published_figures(table, style):
    text = comparison.render(table, style)
    assert all(policy in text for policy in table["policy"])
    assert "mdp (upper bound)" in text
    assert "21.39" in text
    assert "POMCP 20.71 ± 0.21" in text


def test_expensive_planners_get_fewer_episodes_unless_told(monkeypatch):
    monkeypatch.setattr("harness.policy.rollout.RolloutPolicy.max_episodes", 3)
    monkeypatch.setattr("harness.score.comparison.EPISODES", 20)
    counts = harness.compare("rocksample-7x8", ["exit", "rollout:1"], engine="tables")["episodes"]
    assert counts.tolist() == [20, 3]
    counts = harness.compare("rocksample-7x8", ["rollout:1"], episodes=5, engine="tables")["episodes"]
    assert counts.tolist() == [5]


def test_the_default_is_all_that_the_domain_knows(rocksample):
    table = harness.compare(rocksample, episodes=2, engine="tables")
    assert table["policy"].tolist() == [
        "random",
        "random-legal",
        "exit",
        "rollout:100",
        "accuracy:0.93",
        "belief:0.84",
        "thresholds",
        "ge",
        "ge-feedback",
        "qmdp",
        "sarsop",
        "mdp",
    ]


def test_scores_are_never_shaped(bordercross):
    plain, shaped = (
        harness.compare(d, ["sarsop"], episodes=5, engine="tables")
        for d in (bordercross, bordercross.shaped("potential"))
    )
    assert plain["mean"].tolist() == shaped["mean"].tolist() == [500.0]


def test_nothing_runs_before_everything_is_checked(monkeypatch):
    monkeypatch.setattr("harness.score.comparison.evaluate", lambda *a, **k: pytest.fail("ran"))
    with pytest.raises(harness.PolicyError):
        harness.compare("rocksample-7x8", ["exit", "no-such-policy"], engine="tables")
