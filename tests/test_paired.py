"""Is mine better? Against SciPy, by hand, and by brute force."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy import stats

import harness
from harness.score.paired import holm, paired
from harness.score.table import COLUMNS, DIFFERENCES

DOMAIN = "rocksample-7x8"


@pytest.mark.parametrize("seed", range(4))
def test_a_difference_is_scipys_paired_test(seed):
    draws = np.random.default_rng(seed)
    others = draws.normal(3, 4, size=draws.integers(2, 60))
    mine = others + draws.normal(0.3, 1, size=len(others))
    found, expected = paired(mine, others), stats.ttest_rel(mine, others)
    assert found.p_value == pytest.approx(expected.pvalue, rel=1e-9)
    assert found.difference / found.sem == pytest.approx(expected.statistic)
    assert found.difference == pytest.approx(mine.mean() - others.mean())


def test_pairing_takes_out_what_both_have_in_common():
    draws = np.random.default_rng(0)
    luck = draws.normal(0, 10, size=1000)
    mine, others = luck + 1 + draws.normal(0, 0.1, 1000), luck
    assert paired(mine, others).sem == pytest.approx(0.1 / 1000**0.5, rel=0.1)


def test_the_probability_of_improvement_is_counted():
    mine, others = np.array([1.0, 5, 5, 2, 7]), np.array([0.0, 5, 6, 1, 7])
    wins = [1.0 if a > b else 0.5 if a == b else 0.0 for a, b in zip(mine, others, strict=True)]
    assert paired(mine, others).improvement == pytest.approx(sum(wins) / 5)


def test_only_common_episodes_are_paired():
    mine = np.arange(6.0)
    found = paired(mine, np.array([0.0, 0.0, 5.0]))
    assert found[:2] == (3, pytest.approx((0 + 1 - 3) / 3))
    assert paired(np.array([0.0, 0.0, 5.0]), mine).difference == -found.difference


@pytest.mark.parametrize("count", [1, 2, 5])
def test_differences_without_scatter_are_tested_by_their_signs(count):
    """All sign patterns are equally likely where neither is better: how many are as extreme as all alike?"""
    sums = [abs(sum(signs)) for signs in itertools.product((-1, 1), repeat=count)]
    assert paired(np.full(count, 3.0), np.zeros(count)).p_value == sums.count(count) / len(sums)
    alike = paired(np.ones(count), np.ones(count))
    assert (alike.pairs, alike.difference, alike.improvement, alike.p_value) == (count, 0.0, 0.5, 1.0)
    assert alike.sem == 0.0 if count > 1 else np.isnan(alike.sem)  # one pair says nothing of its error


def test_p_values_of_equal_policies_are_uniform():
    draws = np.random.default_rng(7)
    p = [paired(*draws.exponential(size=(2, 200))).p_value for _ in range(2000)]
    assert stats.kstest(p, "uniform").pvalue > 0.01


@pytest.fixture(scope="module")
def table():
    return harness.compare(
        DOMAIN, ["exit", "belief", "mdp"], against="sarsop", episodes=300, engine="tables"
    ).set_index("policy")


def test_the_table_says_what_the_episodes_say(table):
    theirs = harness.evaluate(DOMAIN, "sarsop", episodes=300, engine="tables")
    tests = []
    for name in ("exit", "belief:0.84"):
        mine, row = harness.evaluate(DOMAIN, name, episodes=300, engine="tables"), table.loc[name]
        assert (row["against"], row["pairs"]) == ("sarsop", 300)
        for prefix, a, b in (("", mine.returns, theirs.returns), ("discounted_", mine.discounted, theirs.discounted)):
            assert row[f"{prefix}difference"] == pytest.approx((a - b).mean())
            assert row[f"{prefix}difference_sem"] == pytest.approx((a - b).std(ddof=1) / 300**0.5)
            assert row[f"{prefix}improvement"] == pytest.approx((a > b).mean() + (a == b).mean() / 2)
            tests.append(stats.ttest_rel(a, b).pvalue)
    adjusted = stats_holm(tests)
    shown = [table.loc[name, f"{prefix}p_value"] for name in ("exit", "belief:0.84") for prefix in ("", "discounted_")]
    assert shown == pytest.approx(adjusted, rel=1e-6)


def stats_holm(p_values):
    """The definition, slowly: the largest of all smaller ones times what was left to test."""
    ordered = sorted(p_values)
    steps = {p: min(1, max((len(ordered) - k) * q for k, q in enumerate(ordered) if q <= p)) for p in ordered}
    return [steps[p] for p in p_values]


def test_the_reference_and_the_bound_have_no_difference(table):
    assert table.index.tolist() == ["exit", "belief:0.84", "mdp", "sarsop"]
    assert table.loc[["mdp", "sarsop"], list(DIFFERENCES)].isna().all(axis=None)


def test_without_a_reference_there_are_no_such_columns():
    assert list(harness.compare(DOMAIN, "exit", episodes=2, engine="tables")) == list(COLUMNS)


def test_the_reference_is_found_in_any_spelling_and_played_once():
    class Leave:
        name = "mine"

        def reset(self, batch): ...

        def act(self, batch):
            return np.full(batch.size, batch.domain.action("right()"))

    mine = Leave()
    for against, name in (("belief", "belief:0.84"), ("belief:0.84", "belief:0.84"), (mine, "mine"), ("mine", "mine")):
        frame = harness.compare(DOMAIN, ["belief", mine], against=against, episodes=5, engine="tables")
        assert frame["policy"].tolist() == ["belief:0.84", "mine"]
        assert frame["against"].dropna().tolist() == [name]
    named = harness.compare(DOMAIN, {"a": "belief", "b": mine}, against="a", episodes=5, engine="tables")
    assert named["against"].dropna().tolist() == ["a"]
    assert harness.compare(DOMAIN, [mine], against=Leave(), episodes=5, engine="tables")["difference"].iloc[0] == 0


def test_rollouts_thousand_episodes_are_paired_with_the_first_of_the_others(monkeypatch):
    monkeypatch.setattr("harness.policy.rollout.RolloutPolicy.max_episodes", 3)
    monkeypatch.setattr("harness.score.comparison.EPISODES", 20)
    frame = harness.compare(DOMAIN, ["exit", "sarsop"], against="rollout:1", engine="tables")
    assert frame["pairs"].tolist()[:2] == [3, 3]


def test_nothing_can_be_compared_with_a_bound():
    with pytest.raises(harness.PolicyError, match="plays no episodes"):
        harness.compare(DOMAIN, ["exit", "mdp"], against="mdp", engine="tables")


def test_holm_counts_what_ctrl_c_left_undone(monkeypatch):
    """With more tests to come, the p-values of the rows finished are those of the larger family."""
    from harness.score import comparison

    real, played = comparison.evaluate, []

    def stopped(domain, policy, **settings):
        if len(played) == 2:
            raise KeyboardInterrupt
        played.append(policy)
        return real(domain, policy, **settings)

    monkeypatch.setattr(comparison, "evaluate", stopped)
    with pytest.raises(comparison.Interrupted) as stop:
        harness.compare(DOMAIN, ["sarsop", "belief", "exit"], against="sarsop", episodes=50, engine="tables")
    row = stop.value.table.iloc[1]
    a, b = (real(DOMAIN, name, episodes=50, engine="tables").returns for name in ("belief:0.84", "sarsop"))
    c, d = (real(DOMAIN, name, episodes=50, engine="tables").discounted for name in ("belief:0.84", "sarsop"))
    raw = [stats.ttest_rel(a, b).pvalue, stats.ttest_rel(c, d).pvalue]
    assert [row["p_value"], row["discounted_p_value"]] == pytest.approx(holm(raw, 4))
