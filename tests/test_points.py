"""The point-based solver: bounds that hold, against brute force, published values, the product grid and simulation."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import harness
from harness.cli import main
from harness.errors import HarnessError, SnapshotError
from harness.model import domain as domains
from harness.policy import alpha
from harness.policy.alpha import AlphaVectorPolicy
from harness.solver import anytime
from harness.solver import solution as solutions
from harness.solver.points import course as points
from tests import models

SIZES = st.sampled_from([(2,), (3,), (5,), (2, 2), (2, 3)])


def solved(domain, gap, most=40, memory=10**9):
    """The course after the work, all bounds on the way checked to come closer only."""
    course = points.begin(domain)
    before = course.lower, course.upper
    for latest in itertools.islice(points.blocks(course, gap, memory), most):
        assert latest.lower >= before[0]
        assert latest.upper <= before[1]
        assert latest.memory <= memory
        course, before = latest, (latest.lower, latest.upper)
    return course


def earned(domain, arrays, episodes=20_000, horizon=200):
    """Mean discounted return of acting by the vectors, and its standard error."""
    policy = AlphaVectorPolicy(domain, solutions.Solution({}, arrays))
    score = harness.evaluate(domain, policy, episodes=episodes, horizon=horizon, engine="tables").score
    return score.discounted_mean, score.discounted_sem


def split_start(rng, domain):
    """The domain with two visible values to start in, each with a prior of its own, and a first reading."""
    t, n = dict(domain.arrays), domain.factor_sizes[0]
    others = [rng.dirichlet(np.ones(size)) for size in domain.factor_sizes[1:]]
    priors = np.array([np.concatenate([rng.dirichlet(np.ones(n)), *others]) for _ in range(2)])
    readings = rng.integers(0, len(t["observation_probability"]), (2, n))
    values = list(itertools.product(*map(range, domain.factor_sizes)))
    offset = domain.factor_offset
    weight = [
        (0.3, 0.7)[v] * np.prod([priors[v, offset[k] + x] for k, x in enumerate(joint)])
        for v in (0, 1)
        for joint in values
    ]
    told = np.full((2, t["prior_observation"].shape[1]), -1)
    told[:, :n] = readings
    t.update(
        start_visible=np.repeat([0, 1], len(values)),
        start_values=np.array(values * 2),
        start_cdf=np.cumsum(weight),
        start_observation=np.array([readings[v][joint[0]] for v in (0, 1) for joint in values]),
        prior_visible=np.array([0, 1]),
        prior_marginals=priors,
        prior_factor=np.array([0, 0]),
        prior_observation=told,
    )
    return domains.from_export(domains.to_record(domain), t)


def brute_force_after_the_first_reading(domain, depth):
    """As :func:`tests.models.brute_force`, where the agent sees the visible value and a reading before it acts."""
    t, seen = domain.arrays, {}
    for v, values, p, q in zip(
        t["start_visible"], t["start_values"], np.diff(t["start_cdf"], prepend=0), t["start_observation"], strict=True
    ):
        for o, z in enumerate(t["observation_probability"][q]):
            seen.setdefault((int(v), o), {})[int(v), tuple(map(int, values))] = p * z
    return sum(models._best(domain, belief, depth) for belief in seen.values())


def flattened(domain):
    """The same model as one hidden factor, its whole state, which readings tell the visible part of."""
    live = np.flatnonzero(~domain.arrays["terminal"])
    joint = list(itertools.product(*map(range, domain.factor_sizes)))
    states = {(int(v), x): i for i, (v, x) in enumerate(itertools.product(live, joint))}
    n, t = domain.n_observations, domain.arrays
    b = models.Builder([len(states)], domain.n_actions, (domain.n_visible + 1) * n)
    for a in range(domain.n_actions):
        b.choice(0, [_flat_row(domain, b, states, v, x, a) for v, x in states])
    b.end()
    start = int(t["prior_visible"][0])
    prior = [
        float(np.prod([t["prior_marginals"][0, domain.factor_offset[k] + y] for k, y in enumerate(x)]))
        if v == start
        else 0.0
        for v, x in states
    ]
    return b.domain("flat", domain.discount, [False, True], 0, [prior])


def _flat_row(domain, b, states, v, x, a):
    t, n = domain.arrays, domain.n_observations
    k, row = t["factor"][v * domain.n_actions + a], t["first_row"][v * domain.n_actions + a]
    row += 0 if k < 0 else x[k]
    outcomes = []
    for j in range(t["row_outcomes"][row], t["row_outcomes"][row + 1]):
        after = int(t["outcome_visible"][j])
        read = np.zeros((domain.n_visible + 1) * n)
        read[after * n : after * n + n] = t["observation_probability"][t["outcome_observation"][j]]
        y = x if k < 0 else (*x[:k], int(t["outcome_value"][j]), *x[k + 1 :])
        ends = bool(t["terminal"][after])
        outcomes.append(
            (
                int(ends),
                0 if ends else states[after, y],
                float(t["outcome_probability"][j]),
                b.reading(read),
                float(t["outcome_reward"][0][j]),
            )
        )
    return outcomes


@pytest.mark.parametrize(
    ("domain", "value"),
    [
        (models.rocksample(3, [(1, 1), (2, 0)], (0, 1)), 15.7105),
        (models.rocksample(4, [(3, 1), (2, 1), (1, 3), (1, 0)], (0, 2)), 19.0100),
        (flattened(models.rocksample(3, [(1, 1), (2, 0)], (0, 1))), 15.7105),
    ],
)
def test_small_rocksample_has_the_value_that_two_other_programs_found(domain, value):
    course = solved(domain, 1e-4)
    assert course.lower - 5e-5 <= value <= course.upper + 5e-5
    assert course.upper - course.lower <= 1e-4


def test_tiger_has_the_value_of_appl_s_log():
    course = solved(models.tiger(), 1e-3)
    assert course.lower <= 19.3721
    assert course.upper >= 19.3711
    assert course.upper - course.lower <= 1e-3
    mean, sem = earned(course.domain, points.arrays(course))
    assert mean >= course.lower - 4 * sem


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), SIZES)
def test_the_bounds_hold_on_random_models(seed, sizes):
    rng = np.random.default_rng(seed)
    discount, depth = 0.1, 4
    domain = models.random_domain(rng, list(sizes), 2, 2, 2, discount)
    within = models.brute_force(domain, depth)
    tail = discount**depth * np.abs(domain.arrays["outcome_reward"]).max() / (1 - discount)
    course = solved(domain, 1e-4)
    assert course.lower <= within + tail
    assert course.upper >= within - tail
    assert course.lower <= course.upper <= course.lower + 1e-4


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1), SIZES)
def test_several_starts_and_a_first_reading_are_weighed(seed, sizes):
    rng = np.random.default_rng(seed)
    discount, depth = 0.1, 4
    domain = split_start(rng, models.random_domain(rng, list(sizes), 2, 2, 2, discount))
    within = brute_force_after_the_first_reading(domain, depth)
    tail = discount**depth * np.abs(domain.arrays["outcome_reward"]).max() / (1 - discount)
    found = harness.solve(domain, gap=1e-4)
    assert found.lower <= within + tail
    assert found.upper >= within - tail
    assert found.gap <= 1e-4
    mean, sem = earned(domain, found.solution.arrays, 2000, 30)
    assert mean >= found.lower - 5 * sem


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 2**32 - 1), SIZES)
def test_far_sighted_bounds_meet_those_of_the_product_grid(seed, sizes):
    domain = models.random_domain(np.random.default_rng(seed), list(sizes), 3, 3, 2, 0.9)
    mine = solved(domain, 0.05, 3)
    grid = anytime.begin(domain)
    for latest in itertools.islice(anytime.blocks(grid, 0.05, 10**8), 12):
        grid = latest
    assert mine.lower <= grid.upper
    assert grid.lower <= mine.upper
    mean, sem = earned(domain, points.arrays(mine), 2000, 300)
    assert mine.lower - 5 * sem <= mean


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1), SIZES)
def test_every_vector_is_carried_by_those_kept_with_it(seed, sizes):
    """At any belief a vector promises no more than its action pays now and the best vectors promise next."""
    rng = np.random.default_rng(seed)
    domain = models.random_domain(rng, list(sizes), 3, 3, 2, 0.9)
    course = solved(domain, 0.1, 3)
    joint = list(itertools.product(*map(range, sizes)))
    for kept in (points.arrays(course), points.rounded(course)[0]):
        for v, a, vector in zip(kept["visible"], kept["actions"], kept["values"], strict=True):
            belief = rng.dirichlet(np.full(len(joint), 0.5))
            assert belief @ vector <= backed_up(domain, kept, int(v), int(a), belief, joint) + 1e-12


def test_what_is_stored_has_few_digits_and_is_worth_nearly_as_much():
    course = solved(models.rocksample(4, [(3, 1), (2, 1), (1, 3), (1, 0)], (0, 2)), 0.5)
    exact, (kept, less) = points.arrays(course), points.rounded(course)
    assert 0 < less <= points.LEFT * (course.upper - course.lower)
    lowered = exact["values"] - kept["values"]
    assert (lowered > 0).all()
    assert (lowered <= less).all()
    assert kept["values"].dtype == np.float32
    assert len(np.unique(np.round(kept["values"] * 2**30) % 2**12)) == 1  # no finer than 2⁻¹⁸
    here = kept["visible"] == course.domain.arrays["prior_visible"][0]
    assert kept["values"][here].mean(axis=1).max() >= course.lower - less  # at the start all is equally likely


def backed_up(domain, kept, v, a, belief, joint):
    t, total, after = domain.arrays, 0.0, {}
    k, first = t["factor"][v * domain.n_actions + a], t["first_row"][v * domain.n_actions + a]
    for p, x in zip(belief, joint, strict=True):
        row = first if k < 0 else first + x[k]
        for j in range(t["row_outcomes"][row], t["row_outcomes"][row + 1]):
            q, vp = p * t["outcome_probability"][j], int(t["outcome_visible"][j])
            total += q * t["outcome_reward"][0][j]
            y = x if k < 0 else (*x[:k], int(t["outcome_value"][j]), *x[k + 1 :])
            for o, z in enumerate(t["observation_probability"][t["outcome_observation"][j]]):
                if not t["terminal"][vp]:
                    after.setdefault((vp, o), np.zeros(len(joint)))[joint.index(y)] += q * z
    return total + domain.discount * sum(
        (kept["values"][kept["visible"] == w] @ b).max() for (w, _), b in after.items()
    )


def test_the_lost_robot_is_found():
    """bordercross-7x8-random; the stored record of APPL's pomdpsol says 277.352 to 277.353."""
    found = harness.solve("bordercross-7x8-random", gap=0.1)
    assert found.gap <= 0.1
    assert found.lower <= 277.353
    assert found.upper >= 277.352
    mean, sem = earned(found.domain, found.solution.arrays, horizon=50)
    assert mean >= found.lower - 4 * sem
    assert (np.diff(found.history["lower"]) >= 0).all()
    assert (np.diff(found.history["upper"]) <= 0).all()
    assert found.history["vectors"].iloc[-1] > 0
    assert "alpha vectors" in repr(found)


def test_the_same_work_gives_the_same_bounds():
    domain = models.rocksample(4, [(3, 1), (2, 1), (1, 3), (1, 0)], (0, 2))
    first, again = (solved(domain, 0.01, 3) for _ in range(2))
    assert (first.lower, first.upper) == (again.lower, again.upper)
    for name, array in points.arrays(first).items():
        assert np.array_equal(array, points.arrays(again)[name])


def test_it_keeps_to_the_memory_and_ends_where_that_does():
    domain = models.rocksample(4, [(3, 1), (2, 1), (1, 3), (1, 0)], (0, 2))
    least = points.begin(domain).memory
    course = solved(domain, 1e-6, 1000, 2 * least)  # checks every block
    assert course.memory > least
    assert course.upper - course.lower > 1e-6
    assert course.lower <= 19.0101
    assert course.upper >= 19.0099


def test_ties_are_allowed_for_as_they_are_played():
    assert points._TIE == alpha.TIE


def test_a_solution_is_a_file_and_a_policy_again(tmp_path):
    found = harness.solve("bordercross-7x8-random", gap=1)
    path = tmp_path / "lost.npz"
    solutions.save(path, found.domain, found.solution)
    score = harness.evaluate("bordercross-7x8-random", f"alpha:{path}", episodes=100, engine="tables").score
    assert score.mean > 400
    with pytest.raises(SnapshotError, match="another model"):
        harness.evaluate("rocksample-7x8", f"alpha:{path}", episodes=10)


def test_what_simulated_episodes_act_by_is_kept(tmp_path):
    files = [tmp_path / "all.npz", tmp_path / "kept.npz"]
    for path, more in zip(files, ([], ["--keep-used", "20"]), strict=True):
        assert main(["solve", "bordercross-7x8-random", "--gap", "5", "--out", str(path), *more]) == 0
    domain = harness.load("bordercross-7x8-random")
    whole, kept = (solutions.read(path, domain) for path in files)
    assert len(kept.arrays["actions"]) < len(whole.arrays["actions"]) == kept.record["vectors_solved"]
    assert (kept.record["lower"], kept.record["upper"]) == (whole.record["lower"], whole.record["upper"])
    mean, sem = earned(domain, kept.arrays, horizon=50)
    assert mean >= kept.record["lower"] - 4 * sem


@pytest.mark.parametrize(
    ("change", "given_", "message"),
    [
        ({"discount": 1.0}, {}, "discount 1; solving needs one between 0 and 1"),
        ({}, {"memory": 1e-5}, "more than the 1e-05 GB allowed"),
        ({}, {"gap": 0}, "gap must be a number above 0"),
    ],
)
def test_what_cannot_be_solved_is_one_sentence(change, given_, message):
    domain = harness.load("bordercross-7x8-random")
    changed = domains.from_export({**domains.to_record(domain), **change}, domain.arrays)
    with pytest.raises(HarnessError, match=message):
        harness.solve(changed, **given_)
