"""Exact expected returns, against recursion over all histories, closed forms, Julia's figures and simulation."""

from __future__ import annotations

import dataclasses
import itertools
import json
import re

import numpy as np
import pytest

import harness
from harness import policy as policies
from harness import registry
from harness.cli import main
from harness.errors import HarnessError, PolicyError
from harness.expectation.chain import endless
from harness.expectation.left import Prospects
from harness.expectation.programs import expected
from harness.expectation.situations import first_layer
from harness.play.evaluation import simulate
from harness.policy.base import Stateless
from harness.policy.converting import controller_of
from harness.policy.fsc import FileController, to_record
from harness.policy.program import ProgramPolicy
from harness.program import parse, words_of
from harness.solver import solution
from tests import models
from tests.conftest import size

CLOSE = 1e-9


def by_histories(domain, decide, depth):
    """Undiscounted and discounted return of ``decide(memory, visible, reading, belief) -> (action, memory)``.

    By recursion over all histories with the joint belief in a dictionary; ``belief`` is unnormalized.
    """
    t = domain.arrays
    starts = np.diff(t["start_cdf"], prepend=0)
    belief = {}
    for v, values, p in zip(t["start_visible"], t["start_values"], starts, strict=True):
        belief[int(v), tuple(map(int, values))] = p
    return _rest(domain, decide, None, int(t["start_visible"][0]), -1, belief, depth, 1.0)


def _rest(d, decide, memory, v, o, belief, depth, weight):
    if depth == 0:
        return np.zeros(2)
    action, memory = decide(memory, v, o, {hidden: p for (_, hidden), p in belief.items()})
    total = np.zeros(2)
    if action < 0:
        return total
    t, after = d.arrays, {}
    for (_, hidden), p in belief.items():
        k, row = t["factor"][v * d.n_actions + action], t["first_row"][v * d.n_actions + action]
        row += 0 if k < 0 else hidden[k]
        for j in range(t["row_outcomes"][row], t["row_outcomes"][row + 1]):
            q = p * t["outcome_probability"][j]
            total += q * t["outcome_reward"][0][j] * np.array([1.0, weight])
            vp = int(t["outcome_visible"][j])
            if not t["terminal"][vp]:
                new = hidden if k < 0 else (*hidden[:k], int(t["outcome_value"][j]), *hidden[k + 1 :])
                for z, chance in enumerate(t["observation_probability"][t["outcome_observation"][j]]):
                    if chance > 0:
                        branch = after.setdefault((vp, z), {})
                        branch[vp, new] = branch.get((vp, new), 0.0) + q * chance
    for (vp, z), branch in after.items():
        total += _rest(d, decide, memory, vp, z, branch, depth - 1, weight * d.discount)
    return total


class Machine:
    """Moves between three places of memory by what it sees; looks at no belief."""

    uses_belief = False
    memory = ("at",)

    def __init__(self, table, actions):
        self.table, self.actions = table, actions

    def reset(self, batch):
        self.at = np.zeros(batch.size, dtype=np.int8)

    def act(self, batch):
        actions = self.actions[self.at, batch.visible, batch.observation]
        self.at = self.table[self.at, batch.visible, batch.observation].astype(np.int8)
        return actions


class Believer(Stateless):
    """Chooses by which side of a threshold every belief feature is on, and by the last reading."""

    def __init__(self, actions):
        self.actions = actions

    def act(self, batch):
        sides = (batch.features > 0.4) @ (2 ** np.arange(batch.features.shape[1]))
        return self.actions[sides, batch.visible, batch.observation]


@pytest.fixture(scope="module")
def unknown():
    """A domain of anything, and what random policies on it need."""
    rng = np.random.default_rng(3)
    return models.random_domain(rng, (2, 3), 3, 3, 2, 0.9), rng


DEPTH = 5


def test_a_policy_with_memory_earns_what_all_histories_say(unknown):
    domain, rng = unknown
    for _ in range(4):
        table, actions = rng.integers(0, 3, (3, 4, 3)), rng.integers(-1, 3, (3, 4, 3))

        def decide(at, v, o, _, table=table, actions=actions):
            at = at or 0
            return actions[at, v, o], table[at, v, o]

        found = harness.exact(domain, Machine(table, actions), horizon=DEPTH)
        assert found.is_exact
        known = by_histories(domain, decide, DEPTH)
        assert [found.mean.low, found.discounted.low] == pytest.approx(known, abs=found.rounding + CLOSE)


def test_a_policy_of_beliefs_earns_what_all_histories_say(unknown):
    domain, rng = unknown
    for _ in range(3):
        actions = rng.integers(0, 3, (4, 4, 3))

        def decide(_, v, o, belief, actions=actions):
            total = sum(belief.values())
            last = [sum(p for hidden, p in belief.items() if hidden[k] == n - 1) / total for k, n in enumerate((2, 3))]
            return actions[(last[0] > 0.4) + 2 * (last[1] > 0.4), v, o], None

        found = harness.exact(domain, Believer(actions), horizon=DEPTH)
        known = by_histories(domain, decide, DEPTH)
        assert [found.mean.low, found.discounted.low] == pytest.approx(known, abs=found.rounding + CLOSE)


ROCKS = dataclasses.replace(
    models.rocksample(3, [(1, 1), (2, 0)], (0, 1)),
    actions=("up()", "right()", "down()", "left()", "sample()", "check(1)", "check(2)"),
    observations=("none", "good", "bad"),
    features=(("belief(1)", 0, 1), ("belief(2)", 1, 1)),
)
CHECK, SAMPLE, RIGHT, DOWN = 5, 4, 1, 2
GOOD, BAD = 1, 2


def test_a_program_earns_what_all_histories_say():
    text = """
        check(1)
        if(belief(1) < 0.6) check(1)
        right()
        if(belief(1) > 0.5) { sample() down() } else check(2)
        if(not 2 == "bad" and 1 == "good") right()
        sample()
        right()
        right()
    """
    policy = ProgramPolicy(parse(text, words_of(ROCKS)))

    def decide(memory, v, o, belief):
        at, first, second = memory or ("check", None, None)
        good = sum(p for hidden, p in belief.items() if hidden[0]) / sum(belief.values())
        if at in ("again", "go"):
            first = o
        if at == "after check(2)":
            second = o
        if at == "check":
            return CHECK, ("again", first, second)
        if at == "again" and good < 0.6:
            return CHECK, ("go", first, second)
        if at in ("again", "go"):
            return RIGHT, ("decide", first, second)
        if at == "decide":
            return (SAMPLE, ("down", first, second)) if good > 0.5 else (CHECK + 1, ("after check(2)", first, second))
        if at == "down":
            return DOWN, ("second", first, second)
        if at in ("second", "after check(2)") and second != BAD and first == GOOD:
            return RIGHT, ("sample", first, second)
        if at in ("second", "after check(2)", "sample"):
            return SAMPLE, ("right", first, second)
        after = {"right": "last", "last": "end"}.get(at)
        return (RIGHT, (after, first, second)) if after else (-1, memory)

    found = harness.exact(ROCKS, policy, horizon=12)
    known = by_histories(ROCKS, decide, 12)
    assert [found.mean.low, found.discounted.low] == pytest.approx(known, abs=found.rounding + CLOSE)


def test_what_differs_in_an_unwatched_belief_only_is_one_situation(rocksample):
    """Twelve readings that nobody asks for are one situation a step, and change nothing."""
    program = parse("check(1)\n" * 12 + "right()\n" * 7, words_of(rocksample))
    found = harness.exact(rocksample, ProgramPolicy(program))
    assert (found.mean.low, found.widest) == (pytest.approx(10, abs=CLOSE), 2)  # good, and bad, for a step
    asked = parse("check(1)\n" * 12 + "if(belief(1) > 0.5) right()\n" + "right()\n" * 7, words_of(rocksample))
    assert harness.exact(rocksample, ProgramPolicy(asked)).widest > 12


def test_closed_forms(rocksample, bordercross):
    crossing = harness.exact(bordercross, "solved")
    assert (crossing.mean.low, crossing.steps.low) == (pytest.approx(500, abs=CLOSE), pytest.approx(12, abs=CLOSE))
    assert crossing.discounted.low == pytest.approx(500 * 0.95**11, abs=CLOSE)
    leaving = harness.exact(rocksample, "exit")
    assert leaving.discounted.low == pytest.approx(10 * 0.95**6, abs=CLOSE)
    assert (leaving.success, leaving.steps) == ((1, 1), (7, 7))
    assert harness.exact(rocksample, "exit", horizon=6).success == (0, 0)


def test_the_first_reading_is_part_of_the_first_situations(hidden):
    layer = first_layer(hidden)
    assert layer.mass.sum() == pytest.approx(1)
    reading = layer.key[:, 0] % 2**32 - 1
    played = next(simulate(hidden, policies.make("random", hidden)[1], "tables", 0, 0, 20_000, 1))
    counts = np.bincount(played.batch.observation, minlength=hidden.n_observations) / 20_000
    found = np.bincount(reading, weights=layer.mass, minlength=hidden.n_observations)
    assert found == pytest.approx(counts, abs=0.015)


@pytest.mark.parametrize(
    "spec", ["ge", "ge-feedback", "accuracy", "belief", "belief:0.95", "thresholds", "sarsop", "solved"]
)
def test_simulation_agrees(rocksample, spec):
    episodes = size(10_000, 100_000)
    score = harness.evaluate(rocksample, spec, episodes=episodes, seed=11, engine="tables").score
    found = harness.exact(rocksample, spec)
    assert found.is_exact
    assert found.rounding < 1e-6
    assert abs(score.mean - found.mean.low) < 4.5 * score.sem
    assert abs(score.discounted_mean - found.discounted.low) < 4.5 * score.discounted_sem
    assert score.steps_mean == pytest.approx(found.steps.low, abs=0.5)
    assert score.success_rate == pytest.approx(found.success.low, abs=0.03)


def test_with_little_memory_the_intervals_hold_the_numbers(rocksample):
    sure = harness.exact(rocksample, "belief:0.98")
    widths = []
    for memory in (20_000, 100_000, 400_000):
        found = harness.exact(rocksample, "belief:0.98", memory=memory)
        assert not found.is_exact
        for name in ("mean", "discounted", "steps", "success"):
            low, high = getattr(found, name)
            assert low - CLOSE <= getattr(sure, name).low <= high + CLOSE
        widths.append(found.mean.high - found.mean.low)
    assert widths == sorted(widths, reverse=True)


def test_what_is_left_earns_at_most_what_julia_says_of_everything_observed(rocksample, hidden):
    for domain in (rocksample, hidden):
        bound = solution.read(registry.policy_path(domain.name, "mdp"), domain, solution.BOUND_KIND).record
        low, high = Prospects(domain, bound["horizon"], 1.0).of(first_layer(domain), 0)
        assert high == pytest.approx(bound["undiscounted"], abs=1e-6)
        assert low == pytest.approx(-100 * bound["horizon"])


def test_many_programs_at_once_earn_what_each_does(rocksample, hidden):
    texts = {
        rocksample: [
            'check(3)\nif(3 == "good") up()\nright()\nsample()\nright()',
            "loop while(belief(2) < 0.9) check(2)\nright()",
            'loop check(1)\nif(not 1 == "bad" and belief(4) > 0.2) sample()\nright()',
            "if(x() < 3) { up() sample() } else down()",
        ],
        hidden: ["loop if(distance() > 2) right(1)\nif(distance() == 0) cooperate()\ndown(2)", "left(1)\nright(2)"],
    }
    for domain, sources in texts.items():
        programs = [parse(text, words_of(domain)) for text in sources]
        found = expected(domain, programs, 15, 100_000, workers=2)
        alone = [harness.exact(domain, ProgramPolicy(program), horizon=15) for program in programs]
        assert found.returns.tolist() == [each.mean.low for each in alone]
        assert found.situations.tolist() == [each.situations for each in alone]
        assert np.isnan(expected(domain, programs, 15, 1).returns).any()


@pytest.mark.parametrize(("spec", "why"), [("random", "draws random numbers"), ("rollout:1", "draws random numbers")])
def test_random_policies_are_refused(rocksample, spec, why):
    with pytest.raises(PolicyError, match=f"{spec} has no exact return: it {why}"):
        harness.exact(rocksample, spec)


def test_a_policy_that_does_not_say_what_it_remembers_is_refused(rocksample):
    class Own:
        def reset(self, batch):
            pass

        def act(self, batch):
            return np.ones(batch.size, dtype=int)

    with pytest.raises(PolicyError, match=r"Own has no exact return: it does not say what it remembers \(memory\)"):
        harness.exact(rocksample, Own())


def test_a_comparison_of_exact_rows(rocksample):
    table = harness.compare(rocksample, ["ge-feedback", "random", "optimum"], exact=True, episodes=40, engine="tables")
    assert table["how"].tolist()[:2] == ["exact", "sampled"]
    row = table.iloc[0]
    assert (row["mean"], row["sem"], row["ci_low"]) == (pytest.approx(50, abs=1e-6), 0, row["mean"])
    text = harness.render(table)
    assert "50.0000" in text
    assert "engine tables, seed 0" in text
    assert harness.render(harness.compare(rocksample, "exit", exact=True)).count("exact") > 1
    with pytest.raises(HarnessError, match="no episodes to compare one by one"):
        harness.compare(rocksample, "ge", against="exit", exact=True)


def test_an_interval_is_shown_as_one(rocksample, monkeypatch):
    from harness.score import comparison

    small = lambda *given, **named: harness.exact(*given, **named, memory=20_000)  # noqa: E731
    monkeypatch.setattr(comparison, "expected_return", small)
    table = harness.compare(rocksample, "belief:0.98", exact=True)
    row = table.iloc[0]
    assert row["how"] == "interval"
    assert row["discounted_low"] < row["discounted_mean"] < row["discounted_high"]
    assert row["share_low"] < row["share_high"]
    assert np.isnan(row["sem"])
    assert f"{np.floor(row['ci_low'] * 100) / 100:.2f} to " in harness.render(table)


def test_evolution_on_exact_fitness(rocksample):
    settings = {"population": 20, "generations": 3, "test_episodes": 20, "score_episodes": 20, "engine": "tables"}
    runs = [
        harness.evolve(rocksample, fitness=how, **settings, workers=n)
        for how, n in itertools.product(("exact", "auto"), (1, 2))
    ]
    for run in runs:
        assert run.history["best"].is_monotonic_increasing  # the elite keeps its fitness: it is no luck
        assert run.best.validation == pytest.approx(harness.exact(rocksample, run.best.policy).mean.low, abs=CLOSE)
        assert run.best.text == runs[0].best.text
        assert (run.finalists["validation_sem"] == 0).all()


LISTEN = {
    "start": "0",
    "nodes": {
        "0": [{"do": "a0()", "go": "heard"}],
        "heard": [{"reading": "o0", "do": "a0()", "go": "left"}, {"do": "a0()", "go": "right"}],
        "left": [{"reading": "o0", "do": "a2()", "go": "0"}, {"do": "a0()", "go": "heard"}],
        "right": [{"reading": "o1", "do": "a1()", "go": "0"}, {"do": "a0()", "go": "heard"}],
    },
}
"""Tiger: opens the other door after two equal readings one after the other."""


PAYNT = {
    "num_nodes": 3,
    "num_observations": 4,
    "action_function": [[3, 0, 2, 3], [0, 0, 2, 3], [0, 1, 2, 0]],
    "update_function": [[1, 1, 2, 0], [0, 2, 0, 0], [1, 1, 0, 1]],
    "action_labels": ["(a0)", "(a1)", "(init)", "(a2)"],
    "observation_labels": ["o0", "o1", "init", "__no_obs__"],
}
"""What PAYNT 0.5.0 found for Tiger in eight seconds, three nodes: of -10.2223 by its model checker, to 1e-4 of it."""


def controller(tmp_path, record, domain):
    path = tmp_path / "controller.json"
    path.write_text(json.dumps(record), encoding="utf-8")
    return policies.make(f"fsc:{path}", domain)[1]


def test_a_controller_earns_what_all_histories_say(tmp_path):
    tiger = models.tiger()

    def decide(memory, v, o, _):
        node = memory or "0"
        rule = next(rule for rule in LISTEN["nodes"][node] if rule.get("reading", f"o{o}") == f"o{o}")
        return int(rule["do"][1]), rule["go"]

    found = harness.exact(tiger, controller(tmp_path, LISTEN, tiger), horizon=8)
    known = by_histories(tiger, decide, 8)
    assert [found.mean.low, found.discounted.low] == pytest.approx(known, abs=CLOSE)


def test_without_a_horizon_a_controller_earns_the_solution_of_its_linear_system(tmp_path, rocksample, hidden):
    tiger = models.tiger()
    policy = controller(tmp_path, LISTEN, tiger)
    found = endless(tiger, policy)
    assert found.error < 1e-9
    assert found.value == pytest.approx(harness.exact(tiger, policy, horizon=700).discounted.low, abs=1e-7)
    always = {"start": "a", "nodes": {"a": [{"do": "a0()"}]}}
    assert endless(tiger, controller(tmp_path, always, tiger)).value == pytest.approx(-1 / (1 - 0.95))
    reading = {"start": "a", "nodes": {"a": [{"do": "check(3)", "go": "b"}]}}
    reading["nodes"]["b"] = [{"reading": "good", "do": "up()", "go": "c"}, {"do": "right()"}]
    reading["nodes"]["c"] = [{"visible": {"y": 5}, "do": "right()"}, {"do": "sample()"}]
    rocks = controller(tmp_path, reading, rocksample)
    known = harness.exact(rocksample, rocks, horizon=50).discounted.low
    assert endless(rocksample, rocks).value == pytest.approx(known, abs=1e-7)
    crossing = {"start": "a", "nodes": {"a": [{"reading": "0", "do": "cooperate()"}, {"do": "right(1)", "go": "b"}]}}
    crossing["nodes"]["b"] = [{"do": "right(2)", "go": "a"}]
    known = harness.exact(hidden, controller(tmp_path, crossing, hidden), horizon=600).discounted.low
    assert endless(hidden, controller(tmp_path, crossing, hidden)).value == pytest.approx(known, abs=1e-6)


CONTROLLED = [
    ("rocksample-7x8", 'loop\nwhile(y() > 2) down()\ncheck(2)\ncheck(1)\nif(2 == "good") sample()\nright()\n'),
    (
        "rocksample-7x8",
        'loop\nif(x() > 1 and 3 == "bad") right() else check(3)\nif(3 == "good" or 4 == "bad") check(4)\n',
    ),
    ("bordercross-7x8-random", "loop\nif(distance() < 3) right(2) else right(1)\nif(distance() == 0) cooperate()\n"),
    ("bordercross-7x8", "right(1)\nright(1)\nwhile(distance() > 2) up(2)\ncooperate()\n"),
]


@pytest.mark.parametrize(("name", "text"), CONTROLLED)
def test_a_program_as_a_controller_earns_the_same(name, text, tmp_path):
    domain = harness.load(name)
    program = parse(text, words_of(domain))
    nodes = controller_of(program, domain)
    assert len(nodes.action) < 60
    path = tmp_path / "controller.json"
    path.write_text(json.dumps(to_record(nodes, domain)), encoding="utf-8")
    known = harness.exact(domain, ProgramPolicy(program))
    for policy in (FileController(domain, nodes), policies.make(f"fsc:{path}", domain)[1]):
        found = harness.exact(domain, policy)
        assert found.mean.low == pytest.approx(known.mean.low, abs=1e-9)
        assert found.discounted.low == pytest.approx(known.discounted.low, abs=1e-9)


def test_beliefs_are_no_finite_memory(rocksample):
    with pytest.raises(PolicyError, match="asks for beliefs, which no finite memory holds"):
        controller_of(parse("if(belief(3) > 0.5) up()", words_of(rocksample)), rocksample)


def test_controller_at_the_command_line(tmp_path, capsys):
    path = tmp_path / "fsc.json"
    assert main(["controller", "rocksample-7x8", "ge-feedback", "--out", str(path)]) == 0
    assert capsys.readouterr().out == f"{path}: 46 nodes; discounted return without a horizon 17.5983\n"
    assert main(["controller", "rocksample-7x8", "ge", "--out", str(path)]) == 2
    assert "asks for beliefs" in capsys.readouterr().err


def test_a_controller_of_paynt_earns_what_paynt_says(tmp_path):
    tiger = models.tiger()
    policy = controller(tmp_path, PAYNT, tiger)
    assert policy.nodes.start == 2
    assert endless(tiger, policy).value == pytest.approx(-10.2223, rel=1e-4)


def test_observations_of_paynt_may_tell_the_visible_value(tmp_path):
    """Of a domain whose actions leave open what is visible next, the exported observations are pairs."""
    domain = models.random_domain(np.random.default_rng(0), [2], 3, 2, 2, 0.5)
    labels = [f"v{v}_{name}" for v in range(domain.n_visible) for name in ("o0", "o1")]
    record = {
        "num_nodes": 1,
        "num_observations": len(labels),
        "action_function": [[z // 2 % 2 for z in range(len(labels))]],
        "update_function": [[0] * len(labels)],
        "action_labels": ["(a0)", "(a1)"],
        "observation_labels": labels,
    }
    nodes = controller(tmp_path, record, domain).nodes
    assert nodes.action[0, :, 1].tolist() == [v % 2 for v in range(domain.n_visible)]


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"start": "nowhere"}, "start must be one of the nodes, not 'nowhere'"),
        ({"nodes": {}}, "at least one node"),
        ({"nodes": {"0": [{"reading": "o0", "do": "a0()"}]}}, "last rule must have no conditions"),
        ({"nodes": {"0": [{"do": "dance()"}]}}, "rule 1: do must be an action of tiger or stop, not 'dance"),
        ({"nodes": {"0": [{"reading": "o7", "do": "a0()"}, {"do": "a0()"}]}}, "rule 1: no reading 'o7'"),
        ({"nodes": {"0": [{"does": "a0()"}]}}, "no key 'does'"),
        (PAYNT | {"action_function": [[{"0": 0.5, "1": 0.5}, 0, 0, 0]] * 3}, "its actions are random"),
        (PAYNT | {"observation_labels": ["o0", "o7", "init", "__no_obs__"]}, "'o7' is no reading of tiger"),
        (PAYNT | {"action_labels": ["(a0)", "(jump)", "(init)", "(a2)"]}, "'(jump)' is no action of tiger"),
    ],
)
def test_a_wrong_controller_is_refused_in_one_sentence(tmp_path, change, why):
    with pytest.raises(PolicyError, match=re.escape(why)):
        controller(tmp_path, LISTEN | change, models.tiger())
