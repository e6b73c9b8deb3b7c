"""Sensors: what is read of several hidden factors after one step, without being asked."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import harness
from harness.engine import rng
from harness.engine.tables import TablesEngine
from harness.ge.defaults import grammar_for
from harness.ge.mapping import derive
from harness.model import domain as domains
from harness.model import validation
from harness.model.joining import joined
from harness.play import population
from harness.play.evaluation import evaluate, simulate
from harness.policy.alpha import AlphaVectorPolicy
from harness.policy.encoding import Encoding
from harness.policy.program import ProgramPolicy
from harness.policy.simple import RandomPolicy
from harness.program import parse, words_of
from harness.show.replay import replay
from tests import models

ROCKS = [(2, 1), (0, 0), (1, 2)]
GRID = 3
REACH = 2.0


@pytest.fixture(scope="module")
def vision():
    return models.field_vision(GRID, ROCKS, (0, 1), d0=REACH)


@pytest.fixture(scope="module")
def mixed():
    """A step that tells and changes things itself, and four sensors of which two read the same factor."""
    return models.random_domain(
        np.random.default_rng(3), [2, 3, 2], 3, 2, 2, 0.9, sensors=[(1, 2), (0, 3), (1, 3), (2, 2)]
    )


class Tracking(RandomPolicy):
    uses_belief = True


class FieldVision:
    """The rules in plain Python; rocks by number, the first one of the greatest weight in the number of a start."""

    def __init__(self, u):
        number = int(u * 2 ** len(ROCKS))
        self.good = [bool(number >> (len(ROCKS) - 1 - i) & 1) for i in range(len(ROCKS))]
        self.cell, self.done, self.words = (0, 1), False, []
        self.weights = dict.fromkeys(itertools.product((False, True), repeat=len(ROCKS)), 1.0)

    def step(self, name, u):
        if self.done:
            return 0.0
        reward = self.act(name)
        if not self.done:
            self.words = []
            for i in range(len(ROCKS)):
                p_good = self.right(i) if self.good[i] else 1 - self.right(i)
                word, u = ("good", u / p_good) if u < p_good else ("bad", (u - p_good) / (1 - p_good))
                self.words.append(word)
            self.weigh()
        return reward

    def act(self, name):
        moves = {"up()": (0, 1), "right()": (1, 0), "down()": (0, -1), "left()": (-1, 0)}
        if name in moves:
            x, y = self.cell[0] + moves[name][0], self.cell[1] + moves[name][1]
            if x == GRID:
                self.done = True
                return 10.0
            if not (x >= 0 and 0 <= y < GRID):
                return -100.0
            self.cell = (x, y)
            return 0.0
        if self.cell not in ROCKS:
            return 0.0
        i = ROCKS.index(self.cell)
        reward, self.good[i] = (10.0 if self.good[i] else -10.0), False
        after = {}
        for bits, weight in self.weights.items():
            emptied = (*bits[:i], False, *bits[i + 1 :])
            after[emptied] = after.get(emptied, 0.0) + weight
        self.weights = after
        return reward

    def right(self, i):
        return 0.5 + 0.5 * 2.0 ** (-math.hypot(self.cell[0] - ROCKS[i][0], self.cell[1] - ROCKS[i][1]) / REACH)

    def weigh(self):
        """Bayes' rule over all combinations of the rocks at once, none of them thought independent."""
        for bits in self.weights:
            for i, word in enumerate(self.words):
                self.weights[bits] *= self.right(i) if bits[i] == (word == "good") else 1 - self.right(i)
        total = sum(self.weights.values())
        self.weights = {bits: weight / total for bits, weight in self.weights.items()}

    def believed(self):
        return [sum(weight for bits, weight in self.weights.items() if bits[i]) for i in range(len(ROCKS))]


def test_episodes_and_beliefs_are_those_of_the_rules_in_plain_python(vision):
    episodes = 60
    slow = [FieldVision(u) for u in rng.uniforms(5, rng.ENGINE, 0, 0, episodes)]
    seen = set()
    for record in simulate(vision, Tracking(), "tables", 5, 0, episodes, 20):
        batch = record.batch
        if record.actions is None:
            assert (batch.observation == -1).all()
            continue
        u = rng.uniforms(5, rng.ENGINE, batch.step, 0, episodes)
        paid = [s.step(vision.actions[a], u_e) for s, a, u_e in zip(slow, record.actions, u, strict=True)]
        assert record.rewards.tolist() == paid
        assert batch.done.tolist() == [s.done for s in slow]
        for e, s in enumerate(slow):
            if not s.done:
                assert tuple(vision.visible_values[batch.visible[e]] - 1) == s.cell
                assert vision.observations[batch.observation[e]] == " ".join(s.words)
                assert batch.features[e] == pytest.approx(s.believed(), abs=1e-12)
                seen.update(s.words)
    assert seen == {"good", "bad"}


def test_the_belief_is_bayes_rule_over_the_joint_value(mixed):
    """By recursion over what the tables say: a weight for every combination of values, none thought independent."""
    episodes = 40
    joint = list(itertools.product(*map(range, mixed.factor_sizes)))
    weights, before = None, None
    for record in simulate(mixed, Tracking(), "tables", 2, 0, episodes, 12):
        batch = record.batch
        if record.actions is None:
            weights = [dict(zip(joint, row, strict=True)) for row in batch.joint()]
        else:
            for e in np.flatnonzero(record.active & ~batch.done):
                seen = (int(batch.visible[e]), int(batch.observation[e]))
                weights[e] = after(mixed, before[e], record.actions[e], weights[e], *seen)
                assert batch.joint()[e] == pytest.approx([weights[e].get(h, 0.0) for h in joint], abs=1e-12)
        before = batch.visible.copy()


def after(domain, v, a, weights, vp, o):
    t, found = domain.arrays, {}
    k, row = t["factor"][v * domain.n_actions + a], t["first_row"][v * domain.n_actions + a]
    for hidden, weight in weights.items():
        here = row + (hidden[k] if k >= 0 else 0)
        for j in range(t["row_outcomes"][here], t["row_outcomes"][here + 1]):
            if t["outcome_visible"][j] == vp:
                new = hidden if k < 0 else (*hidden[:k], int(t["outcome_value"][j]), *hidden[k + 1 :])
                chance = dict(models.observed(domain, a, j, new))[o]
                found[new] = found.get(new, 0.0) + weight * t["outcome_probability"][j] * chance
    total = sum(found.values())
    return {hidden: weight / total for hidden, weight in found.items()}


@pytest.mark.parametrize("name", ["vision", "mixed"])
def test_the_conformance_check_passes_and_can_fail(name, request):
    domain = request.getfixturevalue(name)
    harness.check_domain(domain, engine="tables", episodes=200)
    swapped = {**domain.arrays, "sensor_probability": domain.arrays["sensor_probability"][::-1].copy()}
    swapped["sensor_cdf"] = np.cumsum(swapped["sensor_probability"], axis=1)
    wrong = dataclasses.replace(domain, arrays=swapped)
    played = TablesEngine.step

    def step(self, actions, u):
        self.domain = wrong if self.domain.sensors else self.domain
        return played(self, actions, u)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(TablesEngine, "step", step)
        with pytest.raises(harness.ConformanceError):
            harness.check_domain(domain, engine="tables", episodes=200)


@pytest.mark.parametrize("name", ["vision", "mixed"])
def test_with_its_factors_as_one_it_is_the_same_model(name, request):
    """The same numbers give the same episodes: sensors draw in the order in which observations are numbered."""
    domain = request.getfixturevalue(name)
    flat = joined(domain)
    assert not list(validation.breaches(flat))
    assert flat.factor_sizes == (domain.n_joint,)
    assert joined(flat) is flat
    whole = zip(
        simulate(domain, Tracking(), "tables", 1, 0, 300, 20),
        simulate(flat, Tracking(), "tables", 1, 0, 300, 20),
        strict=True,
    )
    for mine, other in whole:
        assert np.array_equal(mine.rewards, other.rewards)
        assert np.array_equal(mine.batch.visible, other.batch.visible)
        going = ~mine.batch.done
        assert np.array_equal(mine.batch.observation[going], other.batch.observation[going])
        assert np.allclose(mine.batch.joint()[going], other.batch.marginals[going], atol=1e-12)


@settings(max_examples=6, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([((2,), ((0, 2),)), ((2, 3), ((0, 2), (1, 2))), ((2, 2), ((1, 3),))]))
def test_bounds_hold_what_brute_force_over_all_histories_earns(seed, shape):
    discount, depth = 0.1, 3
    draw = np.random.default_rng(seed)
    domain = models.random_domain(draw, list(shape[0]), 2, 2, 1, discount, sensors=shape[1])
    within = models.brute_force(domain, depth)
    tail = discount**depth * np.abs(domain.arrays["outcome_reward"]).max() / (1 - discount)
    found = harness.solve(domain, gap=1e-4)
    assert within - tail - 1e-4 <= found.lower <= found.upper <= within + tail + 1e-4
    assert found.gap <= 1e-4


def test_the_solved_policy_earns_its_bounds_and_more_than_without_sight(vision):
    found = harness.solve(vision, gap=0.3)
    score = evaluate(vision, AlphaVectorPolicy(vision, found.solution), episodes=4000, engine="tables")
    mean, error = score.discounted.mean(), score.discounted.std() / math.sqrt(4000)
    assert found.lower - 5 * error <= mean <= found.upper + 5 * error
    for spec in ("exit", "accuracy:0.7", "belief", "thresholds", "rollout:20", "despot:30", "pomcp:200"):
        few = 20 if spec[0] in "dpr" else 1000
        other = evaluate(vision, spec, episodes=few, engine="tables")
        assert other.discounted.mean() <= found.upper + 5 * other.discounted.std() / math.sqrt(few)
    blind = evaluate(vision, "exit", episodes=10, engine="tables").discounted.mean()
    assert blind < evaluate(vision, "belief", episodes=1000, engine="tables").discounted.mean()
    assert blind < evaluate(vision, "despot:30", episodes=20, engine="tables").discounted.mean()


def test_heuristics_look_at_what_was_read_unasked(vision):
    """No rock is sampled on trust, none that was last read bad, and all that were sampled were worth it."""
    rocks = {tuple(cell): i for i, cell in enumerate(vision.layout["rocks"])}
    sample = vision.action("sample()")
    for spec in ("accuracy:0.7", "belief:0.9", "thresholds"):
        sampled = 0
        _, policy = harness.policy.named(spec, vision)
        before = None
        for record in simulate(vision, policy, "tables", 0, 0, 200, 50):
            for e in np.flatnonzero(record.active) if record.actions is not None else ():
                if record.actions[e] == sample:
                    rock = rocks[tuple(vision.visible_values[before[0][e]])]
                    assert vision.observations[before[1][e]].split()[rock] == "good"
                    assert record.rewards[e] == 10.0  # on the spot the sensor is right
                    sampled += 1
            before = record.batch.visible.copy(), record.batch.observation.copy()
        assert sampled > 100


PROGRAM = """\
right()
if(2 == "good" and not 1 == "bad") down()
else up()
if(belief(1) > 0.6) sample()
if(reading() == "good bad bad") left()
if(3 == "bad") right()
right()
right()
right()
"""


def test_programs_ask_for_the_last_reading_of_a_sensor(vision):
    program = parse(PROGRAM, words_of(vision))
    assert program.text == PROGRAM
    policy = ProgramPolicy(program)
    score = evaluate(vision, policy, episodes=2000, engine="tables")
    played = population.play(vision, [program], population.Episodes(0, 0, 2000, 50))
    assert np.array_equal(played.returns[0], score.returns)
    known = harness.exact(vision, policy)
    assert known.is_exact
    assert abs(known.mean.middle - score.returns.mean()) < 5 * score.returns.std() / math.sqrt(2000)
    second = []
    for record in itertools.islice(simulate(vision, ProgramPolicy(program), "tables", 0, 0, 200, 50), 3):
        if record.batch.step == 1:
            said = [vision.observations[o].split() for o in record.batch.observation]
            second = ["down()" if words[1] == "good" and words[0] != "bad" else "up()" for words in said]
    assert [vision.actions[a] for a in record.actions] == second
    assert set(second) == {"down()", "up()"}


@pytest.mark.parametrize(
    ("text", "message"),
    [('if(4 == "good") up()', "knows no quantity '4'"), ('if(1 == "none") up()', "no reading 'none'.*good bad")],
)
def test_words_of_no_sensor_are_refused(vision, text, message):
    with pytest.raises(harness.PolicyError, match=message):
        parse(text, words_of(vision))


def test_the_default_grammar_asks_each_sensor(vision):
    grammar = grammar_for(vision, None)
    text = grammar.text
    assert "<sensor-1> == <label-1>" in text
    assert "1 | 2 | 3" in text
    assert """'"good"' | '"bad"'""" in text
    draw, asked = np.random.default_rng(0), 0
    for _ in range(200):
        if (found := derive(grammar, draw.integers(0, 256, 60, dtype=np.int32)).phenotype) is not None:
            asked += ' == "' in found
            parse(found, words_of(vision))
    assert asked > 5


@pytest.mark.parametrize("spec", ["exit", "accuracy:0.7"])
def test_exact_returns_are_those_of_many_episodes(vision, spec):
    known = harness.exact(vision, spec, horizon=8)
    score = evaluate(vision, spec, episodes=4000, horizon=8, engine="tables")
    assert known.is_exact
    assert abs(known.mean.middle - score.returns.mean()) <= 5 * score.returns.std() / math.sqrt(4000)


def test_exact_returns_where_steps_tell_too(mixed):
    class Mindful:
        """Acts by its belief over two factors and by the last observation."""

        memory = ()

        def reset(self, batch):
            pass

        def act(self, batch):
            tells = (batch.observation % 3 == 1) ^ (batch.marginals[:, 3] > 0.4)
            return np.where(batch.marginals[:, 0] > 0.5, tells, ~tells).astype(np.int32)

    known = harness.exact(mixed, Mindful(), horizon=4)
    score = evaluate(mixed, Mindful(), episodes=20_000, horizon=4, engine="tables")
    assert known.is_exact
    assert abs(known.mean.middle - score.returns.mean()) < 5 * score.returns.std() / math.sqrt(20_000)


def test_learning_agents_see_each_label_by_itself(vision):
    encoding = Encoding("reading", vision)
    assert encoding.names[:6] == ("1 read good", "1 read bad", "2 read good", "2 read bad", "3 read good", "3 read bad")
    for record in itertools.islice(simulate(vision, RandomPolicy(), "tables", 0, 0, 30, 5), 3):
        shown = encoding(record.batch, np.zeros(30, dtype=np.int32))[:, :6]
        for row, o in zip(shown, record.batch.observation, strict=True):
            words = vision.observations[o].split() if o >= 0 else []
            assert row.tolist() == [float(i < len(words) and words[i] == w) for i in range(3) for w in ("good", "bad")]


def test_an_episode_shows_what_was_read_and_nothing_once_it_has_ended(vision):
    blocks = list(replay(vision, "exit", engine="tables"))
    assert "reading " in blocks[2]
    assert blocks[2].split("reading ")[1].split(",")[0] in vision.observations
    assert "reading" not in blocks[-2]
    assert "reward +10" in blocks[-2]


def test_a_snapshot_keeps_the_sensors(vision, tmp_path):
    domains.save(vision, tmp_path / "vision.npz")
    read = harness.load(tmp_path / "vision.npz")
    assert read == vision
    assert read.sensors == vision.sensors
    assert read.sensors[1].labels == ("good", "bad")
    sensors = (vision.sensors[0]._replace(labels=("bad", "good")), *vision.sensors[1:])
    assert dataclasses.replace(vision, sensors=sensors).model_hash != vision.model_hash


def test_domains_without_sensors_keep_their_hashes_and_arrays(rocksample):
    assert rocksample.sensors == ()
    assert set(rocksample.arrays) == set(domains.ARRAYS)
    assert rocksample.tables.sensors is None
    assert rocksample.model_hash.startswith("5c0cfb6d39da")  # as it was before there were sensors


def rowed(a):
    a["sensor_row"][0, 1] = len(a["sensor_probability"]) - 1


def silent(a):
    a["sensor_row"][2, 0] = -1


def heard(a):
    a["sensor_row"][-1, 0] = 0


def loud(a):
    a["sensor_probability"][4, 0] = 0.9


def drawn(a):
    a["sensor_probability"][4] = a["sensor_cdf"][4] = [0.0, 1.0]
    a["sensor_cdf"][4, 0] = 1e-12


def early(a):
    a["start_observation"][0] = 0


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (rowed, r"sensor_row\[0, 1\] is \d+, which leaves the range 0 … \d+"),
        (silent, r"sensor_row\[2, 0\] is -1, which leaves the range 0"),
        (heard, r"sensor_row\[\d+, 0\] is 0, which leaves the range -1 … -1"),
        (loud, r"sensor_probability\[4\] does not sum to 1"),
        (drawn, r"sensor_cdf\[4, 0\] is not the running sum"),
        (early, "something is read before the first step"),
    ],
)
def test_damaged_arrays_are_refused(vision, tmp_path, damage, message):
    arrays = {name: array.copy() for name, array in vision.arrays.items()}
    damage(arrays)
    domains.save(dataclasses.replace(vision, arrays=arrays), tmp_path / "bad.npz")
    with pytest.raises(harness.SnapshotError, match=message):
        harness.load(tmp_path / "bad.npz")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda s: (s[0]._replace(labels=("good", "good")), *s[1:]), "two labels of the sensor '1'"),
        (lambda s: (s[0]._replace(factor=7), *s[1:]), "reads factor 7, which does not exist"),
        (lambda s: (s[0]._replace(name="2"), *s[1:]), "two sensors share a name"),
        (lambda s: (s[0]._replace(labels=("good",)), *s[1:]), "sensors is no list of"),
        (lambda s: (s[0]._replace(labels=("good", "bad", "so so")), *s[1:]), "are no combinations"),
        (lambda s: s[:2], "observation_probability has the shape"),
    ],
)
def test_sensors_that_do_not_fit_are_refused(vision, tmp_path, change, message):
    changed = dataclasses.replace(vision, sensors=change(vision.sensors), layout={"kind": "none"})
    domains.save(changed, tmp_path / "bad.npz")
    with pytest.raises(harness.SnapshotError, match=message):
        harness.load(tmp_path / "bad.npz")


def test_a_sensor_and_a_check_need_different_names(vision):
    named = dataclasses.replace(vision, actions=(*vision.actions[:4], "check(1)"), layout={"kind": "none"})
    assert any("check(1)" in breach for breach in validation.breaches(named))


def test_what_is_too_large_to_be_joined_says_so(vision):
    many = dataclasses.replace(vision, factor_labels=tuple(("a", "b") for _ in range(16)))
    with pytest.raises(harness.HarnessError, match=r"65,536 joint values .* too many"):
        joined(many)


@pytest.mark.parametrize("ending", ["pomdp", "pomdpx"])
def test_a_model_file_says_the_same(vision, ending, tmp_path):
    harness.write_model(vision, tmp_path / f"model.{ending}")
    read = harness.load(tmp_path / f"model.{ending}")
    assert models.brute_force(read, 2) == pytest.approx(models.brute_force(vision, 2), abs=1e-9)


def test_a_pomdpx_file_says_what_steps_and_sensors_tell(tmp_path):
    """Where the step tells something too, there is an observed variable for that and one for each sensor."""
    b = models.Builder([2, 3], 2, 2)
    b.sensors = [["left", 0, ["l0", "l1"]], ["right", 1, ["r0", "r1", "r2"]]]
    readings = [b.reading([p, 1 - p]) for p in (0.7, 0.2)]
    draw = np.random.default_rng(4)
    for _ in range(2):
        b.choice(0, [[(0, x, 0.4, readings[x], 1.0), (1, 1 - x, 0.6, readings[1 - x], -x)] for x in (0, 1)])
        b.choice(-1, [[(1, 0, 1.0, readings[0], 0.5)]])
    for _ in range(4):
        b.sense([draw.dirichlet(np.ones(2), 2), draw.dirichlet(np.ones(3), 3)])
    made = b.domain("telling", 0.9, [False, False], 0, [[0.5, 0.5], [0.2, 0.3, 0.5]])
    harness.write_model(made, tmp_path / "telling.pomdpx")
    text = (tmp_path / "telling.pomdpx").read_text()
    assert text.count("<ObsVar ") == 3
    read = harness.load(tmp_path / "telling.pomdpx")
    assert read.n_observations == made.n_observations == 12
    assert models.brute_force(read, 3) == pytest.approx(models.brute_force(made, 3), abs=1e-9)


def test_a_model_that_no_file_can_say_is_refused_in_one_sentence(mixed, tmp_path):
    for ending in ("pomdp", "pomdpx"):
        with pytest.raises(harness.HarnessError, match="depends on where the step came from"):
            harness.write_model(mixed, tmp_path / f"model.{ending}")
