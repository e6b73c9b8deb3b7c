"""What there is to earn, as it is stored and as tables show it."""

from __future__ import annotations

import pytest

import harness
from harness import registry
from harness.score import bounds
from harness.score.rendering import outward, rounded_up, shown
from harness.solver import solution
from tests import models
from tests.conftest import size

SOLVED = ("rocksample-7x8", "rocksample-11x11", "rocksample-15x15", "bordercross-7x8", "bordercross-7x8-random")


@pytest.mark.parametrize("name", SOLVED)
def test_the_stored_policy_earns_its_lower_bound_and_no_more_than_the_upper_one(name):
    """Played by the engine, which knows nothing of the solver."""
    domain = harness.load(name)
    known = bounds.optimum(domain)
    assert 0 < known.low <= known.high
    score = harness.evaluate(domain, "solved", episodes=size(20_000, 200_000), horizon=200).score
    assert known.low - 4 * score.discounted_sem < score.discounted_mean < known.high + 4 * score.discounted_sem


@pytest.mark.parametrize("name", SOLVED)
def test_bounds_agree_with_those_of_another_solver(name):
    """APPL's SARSOP, and the value with everything observed, which DiscreteValueIteration.jl solved."""
    domain = harness.load(name)
    known = bounds.optimum(domain)
    if (path := registry.policy_path(name, "sarsop")).exists():
        record = solution.read(path, domain).record
        printed = 1e-5  # of a figure, which SARSOP prints with six digits
        assert record["lower"] * (1 - printed) <= known.high
        assert record["upper"] * (1 + printed) >= known.low
    if (path := registry.policy_path(name, bounds.MDP)).exists():
        assert known.low <= solution.read(path, domain, solution.BOUND_KIND).record["discounted"]


def test_shares_are_intervals_between_the_two_bounds():
    known = solution.Bounds(20.0, 25.0)
    assert bounds.share(10.0, known) == {"share_low": 0.4, "share_high": 0.5, "optimum_low": 20, "optimum_high": 25}
    losing = bounds.share(-10.0, known)
    assert (losing["share_low"], losing["share_high"]) == (-0.5, -0.4)
    assert bounds.share(10.0, None) == {}
    assert bounds.share(10.0, solution.Bounds(-1.0, 25.0))["share_low"] is None  # nothing is sure to be earned


def test_the_table_ends_with_the_closest_bound_and_says_it_outward(rocksample):
    assert bounds.default(rocksample) == ["optimum"]
    table = harness.compare(rocksample, ["exit", "optimum", "mdp"], episodes=5, engine="tables")
    low, high = bounds.optimum(rocksample)
    assert table["discounted_mean"].iloc[1] == high
    cells = shown(table)
    assert cells["of optimum"].tolist() == [f"{table['discounted_mean'].iloc[0] / high:.1%}", "", ""]
    assert float(cells["discounted"][1]) >= high
    assert float(outward(low, high)[0]) <= low <= high <= float(outward(low, high)[1])


def test_what_is_rounded_up_is_not_below_and_less_than_a_step_above():
    for value in (21.7050001, 0.001, -3.019, 2.0, 7.35):
        assert value <= rounded_up(value) < value + 0.01 + 1e-12


def test_a_bound_that_is_not_stored_is_refused_in_one_sentence():
    with pytest.raises(harness.HarnessError, match="no such bound ships for tiger"):
        harness.compare(models.tiger(), ["random", "optimum"], episodes=5, engine="tables")
