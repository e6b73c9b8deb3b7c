"""Online planners: against proven bounds, and that they see no more than an agent may."""

from __future__ import annotations

import math
import random
from dataclasses import replace

import numpy as np
import pytest

import harness
from harness import engine as engines
from harness import policy as policies
from harness.engine.tables import TablesEngine
from harness.model.splitmix import next_uniform
from harness.play.evaluation import evaluate, simulate
from harness.policy.planner import despot, hindsight, scenarios, tree
from harness.policy.planner.random_play import random_return, ways_of
from harness.tuning import sweeping
from tests import models
from tests.conftest import size

PLANNERS = ("pomcp:30", "pomcp:30,rollout=legal", "despot:20,trials=4")


def played(domain, spec, **settings):
    return evaluate(domain, policies.make(spec, domain)[1], engine="tables", **settings)


def small_rocksample():
    """RockSample(3, 2) with what preferred actions need to know: names, the map, and which moves are legal."""
    rocks = [(1, 1), (2, 0)]
    domain = models.rocksample(3, rocks, (0, 1))
    cells = [(x, y) for x in range(3) for y in range(3)]
    first = domain.arrays["row_outcomes"][:-1]
    arrays = {
        **domain.arrays,
        "visible_values": np.array([*cells, (3, 0)], dtype=np.int16),
        "legal": domain.arrays["outcome_reward"][0][first] != -100,
    }
    return replace(
        domain,
        actions=("up()", "right()", "down()", "left()", "sample()", "check(1)", "check(2)"),
        observations=("none", "good", "bad"),
        layout={"kind": "rocksample", "rocks": rocks, "half_efficiency_distance": 20.0},
        arrays=arrays,
    )


@pytest.mark.parametrize(
    ("domain", "spec", "lower", "upper"),
    [  # the bounds are those of `harness solve`, whose kernels are not compiled for this
        (models.random_domain(np.random.default_rng(0), [2, 3], 3, 3, 2, 0.5), "pomcp:500", 0.8396, 0.8406),
        (
            models.random_domain(np.random.default_rng(4), [2, 3], 3, 3, 2, 0.5),
            "despot:200,trials=30,lambda=0",
            1.5673,
            1.5682,
        ),
        (models.tiger(), "pomcp:2000,depth=4", 19.36, 19.38),
        (models.tiger(), "despot:100,trials=30,lambda=0.1", 19.36, 19.38),
        (small_rocksample(), "pomcp:500", 15.7104, 15.7106),
        (small_rocksample(), "despot:100,trials=30", 15.7104, 15.7106),
    ],
)
def test_many_simulations_reach_the_proven_bounds_within_error(domain, spec, lower, upper):
    """What an episode still earns beyond the horizon is less than the error."""
    score = played(domain, spec, episodes=size(50, 1000), horizon=50 if domain.name == "tiger" else 12).score
    assert lower - 3 * score.discounted_sem <= score.discounted_mean
    assert score.discounted_mean <= upper + 3 * score.discounted_sem
    assert played(domain, "random", episodes=2000).score.discounted_mean < lower - 4 * score.discounted_sem


def test_pomcp_estimates_what_the_paper_s_pseudocode_does():
    """Tiger, where random rollouts mislead: action values and visits at the root, by the mean over many searches."""
    n, depth, exploration = 200, 20, 110.0
    domain = models.tiger()
    planner = policies.make(f"pomcp:{n},depth={depth},exploration={exploration}", domain)[1]
    batch = next(simulate(domain, policies.make("random-legal", domain)[1], "tables", 0, 0, 400, 1)).batch
    planner.reset(batch)
    planner.act(batch)
    ours = planner._tree[1][:, :3]
    numbers = random.Random(0)
    theirs = np.array([_textbook(numbers, n, depth, exploration) for _ in range(100)])
    for mine, his in ((ours["visits"], theirs[:, :, 0]), (ours["value"], theirs[:, :, 1])):
        error = np.hypot(mine.std(0) / math.sqrt(len(mine)), his.std(0) / math.sqrt(len(his)))
        assert (np.abs(mine.mean(0) - his.mean(0)) < 4 * error).all()


def _textbook(numbers, simulations, depth, exploration):
    """Visits and value of the three actions of Tiger at its start, after Silver and Veness (2010), algorithm 1."""
    found = {}

    def step(tiger, a):
        if a == 0:
            return tiger, tiger if numbers.random() < 0.85 else 1 - tiger, -1.0
        return numbers.randrange(2), numbers.randrange(2), -100.0 if a - 1 == tiger else 10.0

    def rollout(tiger, d):
        if d == depth:
            return 0.0
        tiger, _, reward = step(tiger, numbers.randrange(3))
        return reward + 0.95 * rollout(tiger, d + 1)

    def simulate(tiger, history, d):
        if d == depth:
            return 0.0
        if history not in found:
            found[history] = [[0, 0.0] for _ in range(3)]
            if history:
                return rollout(tiger, d)
        edges = found[history]
        visits = sum(edge[0] for edge in edges)
        bounds = [q + exploration * math.sqrt(math.log(visits + 1) / n) if n else math.inf for n, q in edges]
        a = numbers.choice([a for a in range(3) if bounds[a] == max(bounds)])
        after, reading, reward = step(tiger, a)
        total = reward + 0.95 * simulate(after, (*history, a, reading), d + 1)
        edges[a][0] += 1
        edges[a][1] += (total - edges[a][1]) / edges[a][0]
        return total

    for _ in range(simulations):
        simulate(numbers.randrange(2), (), 0)
    return found[()]


def test_despot_finds_the_best_regularised_policy_of_its_scenarios():
    """Searched to the end, its value is that of a recursion over all policies, with the same scenarios."""
    domain = models.random_domain(np.random.default_rng(5), [2, 3], 3, 3, 2, 0.8)
    values = []
    for penalty in (0.0, 0.02, 0.3):
        model, bounds = scenarios.model_and_bounds(domain, 3)
        grown = scenarios.empty_tree(6)
        scenarios.plant(model, bounds, grown, 0, domain.arrays["prior_marginals"][0], np.uint64(9), penalty)
        roots = grown.scenarios[:6].copy()
        despot._search(model, bounds, grown, np.uint64(7), 10_000, penalty)
        assert grown.nodes[0]["upper"] - grown.nodes[0]["lower"] < 1e-8
        state = np.array([7], dtype=np.uint64)
        numbers = [next_uniform(state) for _ in range(6 * 3)]
        start = [(int(s["number"]), divmod(int(s["hidden"]), 3)) for s in roots]
        best = _regularised(domain, bounds.floor, numbers, start, 0, 0, penalty)
        values.append(best)
        assert grown.nodes[0]["lower"] == pytest.approx(best, abs=1e-9)
    assert values[0] > values[1] > values[2]


def _regularised(domain, floor, numbers, state, v, depth, penalty):
    """Ye et al. (2017), equation 8, over scenarios (number, hidden values) that share ``v``; 3 steps, 6 scenarios."""
    t, best = domain.tables, 0.8**depth / 6 * len(state) * floor[v]
    for a in range(3 if depth < 3 else 0):
        choice, after, total = t.choices[v * 3 + a], {}, -penalty
        for number, hidden in state:
            row = t.rows[choice["first_row"] + (hidden[choice["factor"]] if choice["factor"] >= 0 else 0)]
            ways = t.outcomes[row["first"] : row["last"]]
            u = numbers[number * 3 + depth]
            i = min(int((ways["cdf"] <= u).sum()), len(ways) - 1)
            left = (u - (ways["cdf"][i - 1] if i else 0.0)) / ways["probability"][i] if len(ways) > 1 else u
            reading = int((t.reading_cdf[ways[i]["reading"]] <= left).sum())
            total += 0.8**depth / 6 * ways[i]["reward"]
            moved = tuple(int(ways[i]["value"]) if k == choice["factor"] else x for k, x in enumerate(hidden))
            if not ways[i]["ends"]:
                after.setdefault((int(ways[i]["visible"]), reading), []).append((number, moved))
        for (to, _), group in after.items():
            total += _regularised(domain, floor, numbers, group, to, depth + 1, penalty)
        best = max(best, total)
    return best


def test_the_fully_observed_value_solves_the_fully_observed_problem():
    """RockSample(3, 2) with both rocks good, one good, none: by counting moves."""
    domain = models.rocksample(3, [(1, 1), (2, 0)], (0, 1))
    value = hindsight.seen_through(domain)[1]
    both = 0.95 * 10 + 0.95**4 * 10 + 0.95**5 * 10  # right, sample, right, down, sample, right
    first = 0.95 * 10 + 0.95**3 * 10
    second = 0.95**3 * 10 + 0.95**4 * 10
    assert value == pytest.approx([0.95**2 * 10, second, first, both], abs=1e-3)
    tiger = hindsight.seen_through(models.tiger())[0]
    assert (tiger >= 200).all()
    assert (tiger < 200.001).all()


def test_a_domain_too_large_for_despot_s_table_is_refused(rocksample, monkeypatch):
    monkeypatch.setattr(hindsight, "MOST_STATES", 10_000)
    with pytest.raises(harness.PolicyError, match="more than 10,000 states"):
        policies.make("despot", rocksample)


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


@pytest.mark.parametrize("spec", ["pomcp:time=2ms", "despot:50,time=2ms"])
def test_a_time_is_a_budget_too(rocksample, spec):
    assert played(rocksample, spec, episodes=2, horizon=3).steps.tolist() == [3, 3]


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
        ("pomcp:depth=0", "depth is a whole number from 1 to 1,000"),
        ("despot:0", "despot: scenarios is a whole number from 1 to 10,000, not '0'"),
        ("despot:trials=x", "trials is a whole number"),
        ("despot:lambda=-1", "lambda is a number from 0"),
        ("despot:exploration=1", "despot has no 'exploration'"),
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


def test_a_sweep_of_despot_varies_the_number_that_is_named():
    sweep = harness.sweep(
        "rocksample-7x8", "despot:20,lambda=0", parameter="trials", values=[1, 4], episodes=2, horizon=4,
        engine="tables",
    )  # fmt: skip
    assert sweep["policy"].tolist() == [f"despot:20,trials={n},lambda=0" for n in (1, 4)]
    again = played(harness.load("rocksample-7x8"), "despot:20,lambda=0,trials=4", episodes=2, horizon=4)
    assert sweep["mean"].iloc[1] == again.score.mean
    with pytest.raises(harness.HarnessError, match="one of: scenarios, trials"):
        harness.sweep("rocksample-7x8", "despot", values=[1], engine="tables")
    with pytest.raises(harness.HarnessError, match="leave time out"):
        harness.sweep("rocksample-7x8", "pomcp:time=5ms", values=[1], engine="tables")


def test_random_play_earns_on_tiger_what_sums_say():
    """Every step draws one of three actions, whose mean reward is the same in both states."""
    tiger, steps, n = models.tiger(), 20, 4000
    t, state = tiger.tables, np.array([7], dtype=np.uint64)
    generator = np.random.default_rng(1)
    returns = [
        random_return(
            ways_of(tiger), t.choices, t.rows, t.outcomes, 3, 0.95, steps, 0, int(generator.integers(3)),
            np.array([[generator.integers(2)]], dtype=np.int16), state,
        )
        for _ in range(n)
    ]  # fmt: skip
    expected = (-1 + (10 - 100) / 2 * 2) / 3 * (1 - 0.95**steps) / (1 - 0.95)
    assert abs(np.mean(returns) - expected) < 4 * np.std(returns) / math.sqrt(n)


def test_ways_are_plain_where_nothing_hidden_matters():
    domain = small_rocksample()
    ways = ways_of(domain).reshape(domain.n_visible, domain.n_actions)
    at = {tuple(cell): v for v, cell in enumerate(domain.visible_values.tolist())}
    right, sample, check = (domain.action(name) for name in ("right()", "sample()", "check(1)"))
    on_rock, beside = ways[at[1, 1]], ways[at[0, 1]]
    assert (on_rock["plain"][sample], beside["plain"][sample]) == (False, True)
    assert beside[right].tolist() == (at[1, 1], True, True, False, 0.0)
    assert beside[check].tolist() == (at[0, 1], True, True, False, 0.0)  # what it reads is not looked at
    assert ways[at[2, 1]][right].tolist()[1:] == (True, True, True, 10.0)
    assert not ways[at[0, 1]][domain.action("left()")]["legal"]
