"""Online planners: against proven bounds, and that they see no more than an agent may."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import harness
from harness import engine as engines
from harness import policy as policies
from harness.engine.tables import TablesEngine
from harness.play.evaluation import evaluate, simulate
from harness.policy.planner import tree
from harness.tuning import sweeping
from tests import models
from tests.conftest import size

PLANNERS = ("pomcp:30", "pomcp:30,rollout=legal")


def played(domain, spec, **settings):
    return evaluate(domain, policies.make(spec, domain)[1], engine="tables", **settings)


@pytest.mark.parametrize(
    ("domain", "spec", "lower", "upper"),
    [  # the bounds are those of `harness solve`, whose kernels are not compiled for this
        (models.random_domain(np.random.default_rng(0), [2, 3], 3, 3, 2, 0.5), "pomcp:500", 0.8396, 0.8406),
        (models.random_domain(np.random.default_rng(4), [2, 3], 3, 3, 2, 0.5), "pomcp:500", 1.5673, 1.5682),
        (replace(models.tiger(), discount=0.6), "pomcp:2000", 0.2519, 0.2584),
    ],
)
def test_many_simulations_reach_the_proven_bounds_within_error(domain, spec, lower, upper):
    """At discounts that simulations can look through: beyond a dozen steps nothing counts."""
    score = played(domain, spec, episodes=size(100, 1000), horizon=12).score
    assert lower - 3 * score.discounted_sem <= score.discounted_mean
    assert score.discounted_mean <= upper + 3 * score.discounted_sem
    assert played(domain, "random", episodes=2000).score.discounted_mean < lower - 4 * score.discounted_sem


@pytest.mark.parametrize("spec", PLANNERS)
def test_neither_batches_nor_threads_change_an_action(rocksample, spec, monkeypatch):
    whole = played(rocksample, spec, episodes=12, horizon=12, workers=1)
    made = policies.make(spec, rocksample)[1]
    made.batch_size = 5
    split = evaluate(rocksample, made, episodes=12, horizon=12, engine="tables", workers=2)
    assert np.array_equal(whole.returns, split.returns)
    assert np.array_equal(whole.steps, split.steps)


@pytest.mark.parametrize("spec", PLANNERS)
def test_the_hidden_state_is_not_read(rocksample, spec, monkeypatch):
    """Turned over under the planner's feet, it changes no action."""
    made: list[TablesEngine] = []
    make = engines.make
    monkeypatch.setattr(engines, "make", lambda *given: made.append(make(*given)) or made[-1])

    class Twice:
        def __init__(self, lie):
            self.planner, self.lie, self.actions = policies.make(spec, rocksample)[1], lie, actions[lie]

        def reset(self, batch):
            self.planner.reset(batch)

        def act(self, batch):
            kept = made[-1].values.copy()
            if self.lie:
                made[-1].values[:] = 1 - kept
            self.actions.append(self.planner.act(batch).copy())
            made[-1].values[:] = kept
            return self.actions[-1]

        def clone(self):
            return Twice(self.lie)

    actions: dict[bool, list] = {False: [], True: []}
    for lie in actions:
        list(simulate(rocksample, Twice(lie), "tables", 3, 0, 6, 8))
    assert len(actions[True]) == 8
    assert np.array_equal(actions[False], actions[True])


@pytest.mark.parametrize("spec", PLANNERS)
def test_the_engine_s_random_numbers_are_not_touched(rocksample, spec):
    class Thinks:
        def __init__(self):
            self.planner = policies.make(spec, rocksample)[1]
            self.reset = self.planner.reset

        def act(self, batch):
            self.planner.act(batch)
            return np.full(batch.size, 5)

        def clone(self):
            return Thinks()

    class Reads:
        def reset(self, batch):
            pass

        def act(self, batch):
            return np.full(batch.size, 5)

    seen = [
        [record.batch.observation.copy() for record in simulate(rocksample, policy, "tables", 1, 0, 20, 5)]
        for policy in (Thinks(), Reads())
    ]
    assert np.array_equal(*seen)


def test_a_domain_with_a_hidden_cell_is_planned_for(hidden):
    """Where a first reading tells, factors are large and some moves are legal for some hidden cells only."""
    assert played(hidden, "pomcp:300", episodes=10).score.mean > 0


def test_the_tree_below_what_came_true_is_kept_and_all_else_dropped():
    """Two actions a history; after action 1 and reading 0 the histories 3, 4 and 5 are left, in their order."""
    nodes, edges = np.empty(8, tree.NODE), np.empty(16, tree.EDGE)
    built = [(-1, 0), (0, 0), (0, 1), (1, 0), (3 * 2, 1), (3 * 2, 0)]  # (edge, reading); 3 hangs on edge 1 of the root
    for node, (edge, reading) in enumerate(built):
        _add(nodes, edges, node, edge, reading)
        edges["value"][2 * node : 2 * node + 2] = 10 * node, 10 * node + 1
        nodes["visits"][node] = node
    assert tree.advance(nodes, edges, 2, 6, 1, 7, 0) == 3
    assert nodes["visits"][:3].tolist() == [3, 4, 5]
    assert nodes["edge"][:3].tolist() == [-1, 0, 0]
    assert edges["value"][:6].tolist() == [30, 31, 40, 41, 50, 51]
    assert edges["child"][0] == 2
    assert nodes["sibling"][2] == 1
    assert tree.advance(nodes, edges, 2, 3, 1, 7, 0) == 1  # nobody has been there
    assert nodes["visits"][0] == 0


def _add(nodes, edges, node, edge, reading):
    nodes[node] = (7, reading, edge, edges["child"][edge] if edge >= 0 else -1, 0, -1)
    edges["child"][2 * node : 2 * node + 2] = -1
    if edge >= 0:
        edges["child"][edge] = node


def test_a_time_is_a_budget_too(rocksample):
    assert played(rocksample, "pomcp:time=2ms", episodes=2, horizon=3).steps.tolist() == [3, 3]


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        ("pomcp:0", "pomcp: simulations is a whole number from 1 to 1,000,000, not '0'"),
        ("pomcp:" + "9" * 5000, "from 1 to 1,000,000"),
        ("pomcp:time=5s", "time is a time as 100ms"),
        ("pomcp:exploration=-1", "exploration is a number from 0"),
        ("pomcp:exploration=nan", "exploration is a number from 0"),
        ("pomcp:rollout=good", "preferred or legal, not 'good'"),
        ("pomcp:5,5", "simulations is given twice"),
        ("pomcp:tim=5ms", "did you mean 'time'"),
        ("pomcp:", "simulations is a whole number"),
    ],
)
def test_wrong_settings_are_explained(rocksample, spec, words):
    with pytest.raises(harness.PolicyError, match=words):
        policies.make(spec, rocksample)


def test_preferred_actions_must_be_named_by_the_domain(bordercross):
    with pytest.raises(harness.PolicyError, match="names no preferred actions"):
        policies.make("pomcp:rollout=preferred", bordercross)


def test_planners_have_rows_where_nothing_is_solved_in_full():
    assert "pomcp:1000" not in policies.default_specs(harness.load("rocksample-7x8"))
    assert "pomcp:1000" in policies.default_specs(harness.load("rocksample-15x15"))


def test_a_sweep_over_simulations_says_what_an_action_takes(tmp_path):
    sweep = harness.sweep(
        "rocksample-7x8", "pomcp:5,exploration=10", start=10, stop=40, log=True, points=3, episodes=3, horizon=6,
        engine="tables", out=tmp_path / "sweep",
    )  # fmt: skip
    assert sweep["simulations"].tolist() == [10, 20, 40]
    assert sweep["policy"].tolist() == [f"pomcp:{n},exploration=10" for n in (10, 20, 40)]
    assert (sweep["milliseconds"] > 0).all()
    for _, row in sweep.iterrows():
        assert row["mean"] == played(harness.load("rocksample-7x8"), row["policy"], episodes=3, horizon=6).score.mean
    assert sweeping.resume(tmp_path / "sweep").equals(sweep)


@pytest.mark.parametrize(
    ("given", "words"),
    [({"start": 5, "stop": 2}, "goes upward"), ({"start": 0, "stop": 2}, "simulations lies between 1")],
)
def test_wrong_ends_of_a_sweep_are_explained(given, words):
    with pytest.raises(harness.HarnessError, match=words):
        harness.sweep("rocksample-7x8", "pomcp", log=True, engine="tables", **given)
