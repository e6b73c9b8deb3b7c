"""Bounds that hold: against published and brute-force values, and against what the policies earn."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import harness
from harness.errors import HarnessError, SnapshotError
from harness.policy.graph import PolicyGraph
from harness.solver import anytime, grid, levels, plans
from harness.solver import solution as solutions
from tests import models
from tests.conftest import size


def earned(solved, episodes=20_000, horizon=200):
    """Mean discounted return of the solver's policy, and its standard error."""
    score = harness.evaluate(
        solved.domain, PolicyGraph(solved.domain, solved.solution), episodes=episodes, horizon=horizon, engine="tables"
    ).score
    return score.discounted_mean, score.discounted_sem


@pytest.mark.parametrize(
    ("n", "rocks", "start", "value"),
    [(3, [(1, 1), (2, 0)], (0, 1), 15.7105), (4, [(3, 1), (2, 1), (1, 3), (1, 0)], (0, 2), 19.0100)],
)
def test_small_rocksample_has_the_value_that_two_other_programs_found(n, rocks, start, value):
    solved = harness.solve(models.rocksample(n, rocks, start), gap=1e-4)
    assert solved.lower - 5e-5 <= value <= solved.upper + 5e-5
    assert solved.gap <= 1e-4


def test_tiger_has_the_value_of_appl_s_log():
    solved = harness.solve(models.tiger(), gap=1e-3)
    assert solved.lower <= 19.3721
    assert solved.upper >= 19.3711
    assert solved.gap <= 1e-3
    mean, sem = earned(solved)
    assert mean >= solved.lower - 4 * sem


def test_a_blind_plan_earns_what_its_actions_do():
    """Against a sum over all hidden states."""
    domain, rng, lengths = models.rocksample(4, [(3, 1), (2, 1), (1, 3), (1, 0)], (0, 2)), np.random.default_rng(3), []
    course = anytime.begin(domain)
    *_, course = anytime.blocks(course, 0.1, 10**9)
    path = np.empty((plans.LONGEST, 2), dtype=np.int32)
    for _ in range(100):
        p, v = rng.choice([0.0, 0.2, 0.5, 0.8, 0.93, 1.0], 4), int(rng.integers(16))
        belief = np.ravel(np.column_stack([1 - p, p]))
        value, length = plans.follow(course.branches, course.plans, course.floor, v, belief, path)
        after, total = models.earned_by(domain, v, belief, path[:length, 1])
        rest = domain.discount**length * sum(chance * course.floor[x] for x, chance in after.items())
        assert value == pytest.approx(total + rest, abs=1e-12)
        assert value >= course.floor[v]
        lengths.append(length)
    assert max(lengths) > 4


def test_a_sparse_grid_is_asked_as_if_its_cells_were_mixed_one_by_one():
    """The base less what its rows fell by, against the plain mixture of the rows, made where there are none."""
    rng, sizes, V = np.random.default_rng(1), (2, 3), 4
    coarse = levels.make([[(0.5, 0.5)], [(0.2, 0.3, 0.5)]])
    fine = levels.make([[(0.5, 0.5), (0.9, 0.1), (0.2, 0.8)], [(0.2, 0.3, 0.5), (0.6, 0.2, 0.2)]])
    base = rng.normal(0, 10, (coarse.cells, V)).astype(np.float32)
    above = grid.sparse(base, np.ascontiguousarray(base.T), coarse, fine, sizes, 2 * fine.cells)
    for cell in rng.permutation(fine.cells)[: fine.cells // 2]:
        row = grid.made(above, cell)
        above.value[row] -= rng.exponential(1, V).astype(np.float32)
    offset = np.array([0, 2, 5])
    for _ in range(50):
        belief, v = np.concatenate([rng.dirichlet(np.ones(n)) for n in sizes]), int(rng.integers(V))
        asked = grid.grid_value(above, offset, v, belief)
        cells, weights = grid.cells_of(above, offset, belief)
        rows = [grid.row_of(above.table, above.cell, cell) for cell in cells]
        rows = [row if row >= 0 else grid.made(above, cell) for row, cell in zip(rows, cells, strict=True)]
        plain = float(weights @ above.value[rows, v].astype(float))
        assert asked == pytest.approx(plain, abs=1e-5)  # rows are of float32


def test_a_problem_without_secrets_is_exact():
    solved = harness.solve("bordercross-7x8", gap=1e-6)
    assert solved.lower == pytest.approx(500 * 0.95**11, abs=1e-6)
    assert solved.upper == pytest.approx(500 * 0.95**11, abs=1e-6)
    assert solved.lower <= 500 * 0.95**11 <= solved.upper
    assert earned(solved, 10, 50) == (pytest.approx(500 * 0.95**11), 0.0)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([(2,), (2, 2), (3,), (2, 3)]))
def test_the_bounds_hold_on_random_models(seed, sizes):
    rng = np.random.default_rng(seed)
    discount, depth = 0.3, 4
    domain = models.random_domain(rng, list(sizes), 2, 2, 2, discount)
    within = models.brute_force(domain, depth)
    tail = discount**depth * np.abs(domain.arrays["outcome_reward"]).max() / (1 - discount)
    solved = harness.solve(domain, gap=1e-3, seconds=5)
    assert solved.lower <= within + tail
    assert solved.upper >= within - tail
    assert solved.lower <= solved.upper
    mean, sem = earned(solved, 2000)
    assert mean >= solved.lower - 5 * sem


def test_the_bounds_come_closer_only(rocksample):
    solved = harness.solve(rocksample, gap=0.5)
    history = solved.history
    assert (np.diff(history["lower"]) >= 0).all()
    assert (np.diff(history["upper"]) <= 0).all()
    assert (np.diff(history["seconds"]) >= 0).all()
    assert solved.lower <= 21.7045  # SPEC section 7
    assert solved.upper >= 21.7036
    mean, sem = earned(solved)
    assert mean >= solved.lower - 4 * sem
    assert "Solved" in repr(solved)
    assert len(solved.plot().axes) == 1


def test_the_same_work_gives_the_same_bounds():
    first, again = (harness.solve(models.rocksample(3, [(1, 1), (2, 0)], (0, 1)), gap=0.01) for _ in range(2))
    assert (first.lower, first.upper) == (again.lower, again.upper)
    for name, array in first.solution.arrays.items():
        assert np.array_equal(array, again.solution.arrays[name])


def test_off_its_graph_the_policy_goes_by_what_it_sees(rocksample):
    """A graph of one node without children: after its action, the way out, which is +10 whatever is hidden."""
    arrays = {
        "action": np.array([rocksample.action("check(1)")], dtype=np.int16),
        "first": np.zeros(2, dtype=np.int32),
        "edge_visible": np.zeros(0, dtype=np.int32),
        "edge_reading": np.zeros(0, dtype=np.int32),
        "edge_node": np.zeros(0, dtype=np.int32),
        "fallback": np.full(rocksample.n_visible, rocksample.action("right()"), dtype=np.int16),
    }
    policy = PolicyGraph(rocksample, solutions.Solution({}, arrays))
    result = harness.evaluate(rocksample, policy, episodes=50, engine="tables")
    assert set(result.returns) == {10.0}
    assert set(result.steps) == {8}


def test_a_solution_is_a_file_and_a_policy_again(tmp_path):
    solved = harness.solve("bordercross-7x8", gap=0.01)
    path = tmp_path / "cross.npz"
    solutions.save(path, solved.domain, solved.solution)
    score = harness.evaluate("bordercross-7x8", f"graph:{path}", episodes=10, engine="tables").score
    assert score.mean == 500
    with pytest.raises(SnapshotError, match="another model"):
        harness.evaluate("rocksample-7x8", f"graph:{path}", episodes=10)


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("action", lambda a: a + 100),
        ("edge_node", lambda a: a + 1000),
        ("edge_visible", lambda a: a - 5000),
        ("first", lambda a: a[::-1].copy()),
        ("fallback", lambda a: a[1:]),
        ("edge_reading", lambda a: a.astype(np.float64)),
    ],
)
def test_a_graph_that_points_outside_is_refused(tmp_path, name, change):
    solved = harness.solve(models.tiger(), gap=0.1)
    assert len(solved.solution.arrays["edge_node"]) > 0
    arrays = {**solved.solution.arrays, name: change(solved.solution.arrays[name])}
    solutions.save(tmp_path / "x.npz", solved.domain, solutions.Solution(solved.solution.record, arrays))
    with pytest.raises(SnapshotError, match=name):
        harness.evaluate(solved.domain, f"graph:{tmp_path / 'x.npz'}", episodes=10)


@pytest.mark.parametrize(
    ("domain", "given_", "message"),
    [
        ("rocksample-7x8", {"gap": 0}, "gap must be a number above 0"),
        ("rocksample-7x8", {"gap": float("nan")}, "gap must be a number above 0"),
        ("rocksample-15x15", {"memory": 0.01}, "more than the 0.01 GB allowed"),
    ],
)
def test_what_cannot_be_solved_is_one_sentence(domain, given_, message):
    with pytest.raises(HarnessError, match=message):
        harness.solve(domain, **given_)


class TestSolvedOnTheWay:
    @pytest.fixture(autouse=True)
    def own_cache(self, tmp_path, monkeypatch):
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))

    def test_it_is_solved_once_and_the_row_has_its_bounds(self, tmp_path, monkeypatch):
        table = harness.compare(models.tiger(), ["solved:1s", "random"], episodes=size(2_000, 20_000), horizon=300)
        row, other = table.iloc[0], table.iloc[1]
        assert row["optimum_low"] <= 19.3721
        assert row["optimum_high"] >= 19.3711  # APPL's log
        assert row["discounted_mean"] > row["optimum_low"] - 4 * row["discounted_sem"]
        assert other[["optimum_low", "share_low"]].isna().all()
        (kept,) = (tmp_path / "pomdp-harness" / "solved").iterdir()
        monkeypatch.setattr("harness.solver.solving.solve", None)
        again = harness.compare(models.tiger(), "solved:1s", episodes=10, horizon=300)
        assert again["optimum_low"][0] == row["optimum_low"]
        monkeypatch.undo()
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
        kept.write_bytes(b"spoilt")
        harness.compare(models.tiger(), "solved:1s", episodes=10, horizon=300)
        assert len(kept.read_bytes()) > 100

    @pytest.mark.parametrize("text", ["10", "0s", "x", "99999s", "-1s", "1.5s", ":"])
    def test_a_time_that_is_none_is_refused(self, text):
        with pytest.raises(harness.HarnessError, match="takes a time as 10s"):
            harness.compare("rocksample-7x8", f"solved:{text}", episodes=5)
