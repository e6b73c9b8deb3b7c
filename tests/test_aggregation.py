"""Figures over several domains: by hand, and against resampling the episodes themselves."""

from __future__ import annotations

import io

import numpy as np
import pandas as pd
import pytest
from scipy import stats

import harness
from harness.score import rendering
from harness.score.aggregation import interquartile_mean

DOMAINS = ("rocksample-7x8", "bordercross-7x8-random")
POLICIES = ("random-legal", "qmdp", "sarsop")
EPISODES = 1000


@pytest.fixture(scope="module")
def table():
    return harness.compare(DOMAINS, [*POLICIES, "mdp"], episodes=EPISODES, engine="tables")


def test_a_figure_is_the_mean_of_the_scaled_means(table):
    rows = table.set_index(["domain", "policy"])["discounted_mean"]
    found = harness.aggregate(table).set_index("policy")
    assert found.index.tolist() == list(POLICIES)
    for policy in POLICIES:
        scaled = []
        for domain in DOMAINS:
            floor, bound = rows[domain, "random-legal"], rows[domain, "mdp"]
            scaled.append((rows[domain, policy] - floor) / (bound - floor))
        assert found.loc[policy, "discounted_mean"] == pytest.approx(np.mean(scaled))
    assert (found["domains"] == 2).all()
    assert found.loc["random-legal"].drop("domains").eq(0).all()  # in every draw


def test_the_intervals_are_those_of_resampled_episodes(table):
    """Brute force: episodes drawn with replacement, domain by domain, what all policies did in an episode together."""
    draws = np.random.default_rng(3)
    bounds = table[table["policy"] == "mdp"].set_index("domain")["discounted_mean"]
    totals = np.zeros((2000, len(POLICIES)))
    for domain in DOMAINS:
        played = [harness.evaluate(domain, p, episodes=EPISODES, engine="tables").discounted for p in POLICIES]
        returns = np.stack(played, axis=1)
        for k in range(len(totals)):
            means = returns[draws.integers(EPISODES, size=EPISODES)].mean(axis=0)
            totals[k] += (means - means[0]) / (bounds[domain] - means[0]) / len(DOMAINS)
    found = harness.aggregate(table, resamples=20_000).set_index("policy").loc[list(POLICIES)]
    width = np.ptp(np.quantile(totals, (0.025, 0.975), axis=0), axis=0)
    for side, quantile in (("low", 0.025), ("high", 0.975)):
        expected = np.quantile(totals, quantile, axis=0)
        assert np.abs(found[f"discounted_mean_{side}"] - expected).le(0.1 * width).all()


def test_the_median_is_over_the_domains():
    """Three domains, no noise: 0.5, 0.6 and 1 of what there is to earn."""
    frame = made([(0.0, 5.0, 10.0), (10.0, 16.0, 20.0), (-1.0, 1.0, 1.0)])
    row = harness.aggregate(frame).set_index("policy").loc["mine"]
    assert row["mean"] == pytest.approx(0.7)
    assert row["median"] == row["median_low"] == row["median_high"] == pytest.approx(0.6)


def made(domains):
    """A table without scatter: returns of random-legal, mine and the bound in each domain."""
    kinds = {"random-legal": "policy", "mine": "policy", "mdp": "upper bound"}
    rows = [
        {"domain": f"d{k}", "policy": name, "kind": kind, "mean": x, "discounted_mean": x}
        for k, values in enumerate(domains)
        for (name, kind), x in zip(kinds.items(), values, strict=True)
    ]
    return pd.DataFrame(rows).assign(sem=0.0, discounted_sem=0.0)


def test_the_same_seed_draws_the_same(table):
    first, again, other = (harness.aggregate(table, seed=seed) for seed in (0, 0, 1))
    pd.testing.assert_frame_equal(first, again)
    assert (first["discounted_mean_low"] != other["discounted_mean_low"]).any()
    assert (first["discounted_mean"] == other["discounted_mean"]).all()


def test_a_table_from_a_file_gives_the_same(table):
    back = pd.read_csv(io.StringIO(harness.render(table, "csv")))
    pd.testing.assert_frame_equal(harness.aggregate(back), harness.aggregate(table))


def test_the_lowest_bound_counts_and_policies_that_all_domains_have():
    frame = made([(0.0, 5.0, 10.0), (0.0, 5.0, 10.0)])
    extra = pd.DataFrame(
        [
            {"domain": "d0", "policy": "solver", "kind": "upper bound", "mean": np.nan, "discounted_mean": 8.0},
            {"domain": "d0", "policy": "here", "kind": "policy", "mean": 1.0, "sem": 0.0, "discounted_mean": 1.0},
        ]
    )
    found = harness.aggregate(pd.concat([frame, extra])).set_index("policy")
    assert found.index.tolist() == ["random-legal", "mine"]
    assert found.loc["mine", "discounted_mean"] == pytest.approx((5 / 8 + 5 / 10) / 2)
    assert found.loc["mine", "mean"] == pytest.approx(0.5)


def test_a_return_without_a_bound_is_left_out(table):
    other = harness.compare(DOMAINS, [*POLICIES, "mdp"], episodes=5, horizon=20, engine="tables")
    found = harness.aggregate(other)
    assert found["mean"].isna().all()
    assert found["discounted_mean"].notna().all()
    assert "nan" not in harness.render(other).lower()


def test_what_is_missing_is_named(table):
    for keep, message in (
        (table["policy"] != "random-legal", "rocksample-7x8 has no row of random-legal"),
        (table["policy"] != "mdp", "rocksample-7x8 has no upper bound"),
        (table["policy"] == "", "no rows"),
    ):
        with pytest.raises(harness.HarnessError, match=message):
            harness.aggregate(table[keep])
    with pytest.raises(harness.HarnessError, match="two rows named qmdp"):
        harness.aggregate(table.replace("sarsop", "qmdp"))
    assert "No aggregate over the domains: rocksample-7x8 has no" in harness.render(table[table["policy"] != "mdp"])


def covering(rows):
    """A table of (domain, policy, discounted mean, its error, bounds of the optimum)."""
    frame = pd.DataFrame(rows, columns=["domain", "policy", "discounted_mean", "discounted_sem", "optimum"])
    low, high = zip(*frame.pop("optimum"), strict=True)
    return frame.assign(kind="policy", optimum_low=low, optimum_high=high)


def test_coverage_is_over_the_domains_that_a_policy_plays():
    """By hand: shares of the upper bound, up to those of the lower one; below 0 and without bounds there are none."""
    none = (np.nan, np.nan)
    frame = covering([
        ("d0", "random-legal", 2.0, 0.0, (8.0, 10.0)), ("d0", "mine", 6.0, 0.0, (8.0, 10.0)),
        ("d1", "random-legal", 0.0, 0.0, (4.0, 4.0)), ("d1", "mine", 3.0, 0.0, (4.0, 4.0)),
        ("d1", "here", 4.0, 0.0, (4.0, 4.0)),
        ("d2", "random-legal", -20.0, 0.0, (-6.0, -5.0)), ("d2", "mine", -8.0, 0.0, (-6.0, -5.0)),
        ("d3", "mine", 7.0, 0.0, none), ("d3", "nowhere", 7.0, 0.0, none),
    ])  # fmt: skip
    found = harness.coverage(frame).set_index("policy")
    assert found.index[0] == "mine"
    assert found["played"].to_dict() == {"mine": 4, "random-legal": 3, "here": 1, "nowhere": 1}
    assert found["share_domains"].to_dict() == {"mine": 2, "random-legal": 2, "here": 1, "nowhere": 0}
    assert found["scale_domains"].to_dict() == {"mine": 3, "random-legal": 3, "here": 1, "nowhere": 0}
    mine = found.loc["mine"]
    assert mine["share_mean"] == mine["share_mean_low"] == pytest.approx((6 / 10 + 3 / 4) / 2)
    assert mine["share_mean_high"] == pytest.approx((6 / 8 + 3 / 4) / 2)
    assert mine["scale_mean"] == pytest.approx((4 / 8 + 3 / 4 + 12 / 15) / 3)
    assert mine["scale_mean_high"] == pytest.approx((4 / 6 + 3 / 4 + 12 / 14) / 3)
    assert found.loc["random-legal", ["scale_mean", "scale_mean_low", "scale_mean_high"]].eq(0).all()
    assert found.loc["nowhere"].filter(regex="mean|iqm").isna().all()
    cells = rendering.covered(found.reset_index()).set_index("policy")
    assert cells.loc["mine", "of optimum"] == "0.675 [0.675, 0.750] of 2"
    assert cells.loc["nowhere", "scaled"] == ""


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 8, 11])
def test_the_middle_half_is_scipys_trimmed_mean(n):
    values = np.random.default_rng(n).normal(size=(n, 3))
    assert interquartile_mean(values, axis=0) == pytest.approx(stats.trim_mean(values, 0.25, axis=0))


def test_coverage_of_noisy_means_has_the_normal_interval():
    """Two domains with independent errors: the mean share has the error that they combine to."""
    frame = covering([(d, "mine", 5.0, 0.3, (10.0, 10.0)) for d in ("d0", "d1")])
    row = harness.coverage(frame, resamples=100_000).iloc[0]
    half = 1.96 * 0.03 / np.sqrt(2)
    assert [row["share_mean_low"], row["share_mean_high"]] == pytest.approx([0.5 - half, 0.5 + half], abs=0.001)


def test_coverage_misuse():
    frame = covering([("d0", "mine", 5.0, 0.3, (10.0, 10.0))])
    with pytest.raises(harness.HarnessError, match="no column optimum_low"):
        harness.coverage(frame.drop(columns="optimum_low"))
    with pytest.raises(harness.HarnessError, match="d0 has two rows named mine"):
        harness.coverage(pd.concat([frame, frame]))
    with pytest.raises(harness.HarnessError, match="resamples"):
        harness.coverage(frame, resamples=0)
