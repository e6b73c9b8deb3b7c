"""Figures over several domains: by hand, and against resampling the episodes themselves."""

from __future__ import annotations

import io

import numpy as np
import pandas as pd
import pytest

import harness

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
