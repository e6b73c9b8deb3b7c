"""The smooth expected return, against closed forms, all histories, difference quotients and the hard return."""

from __future__ import annotations

import math

import numpy as np
import pytest

import harness
from harness.errors import HarnessError, PolicyError
from harness.expectation.smooth.layers import thin
from harness.policy.base import Stateless
from harness.policy.heuristic import rock_map
from harness.policy.program import ProgramPolicy
from harness.program import parse, words_of
from tests.conftest import size

ALL = 10**6  # situations: nothing is left to chance
NESTED = """loop
while(belief(2) > 0.31 and belief(2) < 0.74) check(2)
if(not belief(2) > 0.66 or belief(1) < 0.45) { check(1) if(1 == "good") up() }
else { down() if(belief(2) > 0.81) left() }
if(belief(1) > 0.57) sample()
right()
"""


def sigmoid(x):
    return 1 / (1 + math.exp(-x))


def program(domain, text):
    return parse(text, words_of(domain))


def quotient(at, theta, i, width=1e-5):
    """Richardson's central difference quotient of ``at`` by the i-th number."""

    def central(h):
        step = h * np.eye(len(theta))[i]
        return (at(theta + step) - at(theta - step)) / (2 * h)

    return (4 * central(width) - central(2 * width)) / 3


def thresholds(theta):
    return "thresholds:" + ",".join(
        f"{name}={float(x)!r}" for name, x in zip(("accept", "reject", "ahead", "aside", "wait"), theta, strict=True)
    )


class TestValue:
    @pytest.mark.parametrize(("constant", "temperature"), [(0.4, 0.1), (0.9, 0.03), (0.99, 0.2)])
    def test_one_gate_by_hand(self, rocksample, constant, temperature):
        """Moving left from the first column costs 100: once before a reading, once after it."""
        text = f"if(belief(2) > {constant}) left()\ncheck(2)\nif(belief(2) > {constant}) left()\n"
        right = rock_map(rocksample).accuracy[rocksample.arrays["start_visible"][0], 1]
        gates = [sigmoid((b - constant) / temperature) for b in (0.5, right, 1 - right)]
        expected = -100 * (gates[0] + gates[1] / 2 + gates[2] / 2)
        found = harness.smooth(rocksample, ProgramPolicy(program(rocksample, text)), temperature=temperature)
        assert found.value == pytest.approx(expected, abs=1e-12)
        slopes = [-g * (1 - g) / temperature for g in gates]
        assert found.gradient == pytest.approx([-100 * slopes[0], -50 * (slopes[1] + slopes[2])], abs=1e-9)

    @pytest.mark.parametrize("word", ["belief", "accuracy"])
    def test_heuristics_by_all_histories(self, rocksample, word):
        """Recursion over hidden rocks, gates and readings, with the rules of the paper's algorithms written anew."""
        threshold, temperature, depth = 0.87, 0.15, size(2, 4)
        found = harness.smooth(
            rocksample, f"{word}:{threshold}", temperature=temperature, horizon=depth, situations=ALL
        )
        by_hand = Recursion(rocksample, word, threshold, temperature)
        assert found.value == pytest.approx(by_hand.value(depth), rel=1e-10)
        assert found.thinned == 0

    @pytest.mark.parametrize("spec", ["belief:0.84", "belief:0.97", "accuracy:0.93", "thresholds", "ge", "ge-feedback"])
    def test_cold_it_is_the_hard_one(self, rocksample, spec):
        hard = harness.exact(rocksample, spec)
        cold = harness.smooth(rocksample, spec, temperature=1e-8)
        assert cold.value == pytest.approx(hard.mean.middle, rel=1e-10)
        assert cold.discounted == pytest.approx(hard.discounted.middle, rel=1e-10)
        assert np.abs(cold.gradient).max(initial=0.0) < 1e-6

    def test_cold_it_is_the_hard_one_of_nested_programs_and_other_domains(self, rocksample, hidden):
        made = ProgramPolicy(program(rocksample, NESTED))
        hard = harness.exact(rocksample, made, horizon=12).mean.middle
        assert harness.smooth(rocksample, made, temperature=1e-7, horizon=12).value == pytest.approx(hard, rel=1e-10)
        feature = hidden.features[0][0]
        text = f"loop\nif({feature} > 0.013) right(1) else up(2)\nif({feature} < 0.11) cooperate()\ndown(1)\n"
        made = ProgramPolicy(program(hidden, text))
        hard = harness.exact(hidden, made, horizon=8).mean.middle
        cold = harness.smooth(hidden, made, temperature=1e-9, horizon=8, situations=ALL)
        assert cold.value == pytest.approx(hard, rel=1e-10)


class TestGradient:
    @pytest.mark.parametrize("temperature", [0.02, 0.08])
    @pytest.mark.parametrize(
        ("spec", "theta", "horizon"),
        [
            (lambda x: f"belief:{float(x[0])!r}", [0.87], 5),
            (lambda x: f"accuracy:{float(x[0])!r}", [0.91], 4),
            (thresholds, [0.79, 0.31, 0.96, 0.93, 0.87], 5),
        ],
        ids=["belief", "accuracy", "thresholds"],
    )
    def test_of_heuristics_is_that_of_difference_quotients(self, rocksample, spec, theta, horizon, temperature):
        def at(x):
            return harness.smooth(rocksample, spec(x), temperature=temperature, horizon=horizon, situations=ALL)

        self.check(at, np.array(theta))

    @pytest.mark.parametrize("temperature", [0.01, 0.1])
    def test_of_programs_is_that_of_difference_quotients(self, rocksample, temperature):
        made = program(rocksample, NESTED)

        def at(x):
            policy = ProgramPolicy(made.with_constants(x))
            return harness.smooth(rocksample, policy, temperature=temperature, horizon=7, situations=ALL)

        self.check(at, made.constants)

    @staticmethod
    def check(at, theta):
        found = at(theta)
        assert found.thinned == 0
        for name, gradient in (("value", found.gradient), ("discounted", found.discounted_gradient)):
            by_quotients = [quotient(lambda x, n=name: getattr(at(x), n), theta, i) for i in range(len(theta))]
            assert np.abs(gradient).max() > 1e-4  # or nothing would be compared
            assert gradient == pytest.approx(by_quotients, rel=1e-6, abs=1e-6 * np.abs(gradient).max())


class TestThinning:
    def test_it_leaves_sums_as_they_are_in_the_mean(self):
        generator = np.random.default_rng(1)
        mass = np.abs(generator.standard_cauchy((40, 3)))
        key = np.arange(40)[:, None]
        draws = (np.arange(2_000) + 0.5) / 2_000
        sums = np.zeros((40, 3))
        for draw in draws:
            kept, weights = thin(key, mass, 12, draw)
            assert len(kept) == 12
            assert weights[:, 0].sum() == pytest.approx(mass[:, 0].sum())
            sums[kept[:, 0]] += weights
        assert sums / len(draws) == pytest.approx(mass, abs=0.002 * mass.sum())

    def test_few_are_left_alone(self):
        key, mass = np.arange(5)[:, None], np.ones((5, 2))
        assert thin(key, mass, 5, 0.5)[0] is key

    def test_a_thinned_return_is_unbiased(self, rocksample):
        whole = harness.smooth(rocksample, "belief:0.9", temperature=0.1, horizon=6, situations=ALL)
        drawn = [
            harness.smooth(rocksample, "belief:0.9", temperature=0.1, horizon=6, situations=60, seed=seed)
            for seed in range(200)
        ]
        assert all(each.thinned for each in drawn)
        for exactly, name in ((whole.value, "value"), (whole.gradient[0], "gradient")):
            sample = np.array([np.ravel(getattr(each, name))[0] for each in drawn])
            assert abs(sample.mean() - exactly) < 4 * sample.std(ddof=1) / math.sqrt(len(sample))


class TestTuning:
    def test_it_crosses_a_plateau_on_which_differences_are_zero(self, rocksample):
        """Going left costs 100 after a good reading, unless the constant is above what it makes believe."""
        text = "check(2)\nif(belief(2) > 0.6) left()\n"
        common = {"validation_episodes": 500, "final_episodes": 500, "engine": "tables"}
        stuck = harness.tune(rocksample, text, method="gradient", episodes=500, **common)
        assert not stuck.moved
        found = harness.tune(rocksample, text, method="autodiff", **common)
        assert found.best.score.mean == 0.0
        assert found.start.score.mean < -40
        assert found.stopped

    def test_what_has_no_gates_is_refused_before_anything_is_written(self, rocksample, tmp_path):
        class Sure(Stateless):
            def act(self, batch):
                return np.zeros(batch.size, dtype=np.int32)

        class Own:
            names, start, lower, upper = ("x",), np.array([0.5]), np.zeros(1), np.ones(1)

            def policy(self, theta):
                return Sure()

            def text(self, theta):
                return "own"

        with pytest.raises(PolicyError, match=r"Sure has no comparisons .* tune it by --method cmaes"):
            harness.tune(rocksample, Own(), method="autodiff", out=tmp_path / "run")
        assert not (tmp_path / "run").exists()

    @pytest.mark.parametrize("temperature", [0, -1, math.nan, math.inf, True, "hot"])
    def test_a_temperature_is_a_number_above_zero(self, rocksample, temperature):
        with pytest.raises(HarnessError, match="temperature must be a number from 1e-09 to 1000"):
            harness.smooth(rocksample, "belief", temperature=temperature)

    def test_other_policies_have_no_smooth_return(self, rocksample):
        with pytest.raises(PolicyError, match="no smooth return"):
            harness.smooth(rocksample, "exit", temperature=0.1)


class Recursion:
    """The two heuristics with gates, by recursion over what happens; the joint belief is a dictionary."""

    def __init__(self, domain, word, threshold, temperature):
        self.d, self.word, self.c, self.tau = domain, word, threshold, temperature
        self.map, self.t = rock_map(domain), domain.arrays

    def value(self, depth):
        v = int(self.t["start_visible"][0])
        chances = np.diff(self.t["start_cdf"], prepend=0)
        belief = {tuple(map(int, x)): p for x, p in zip(self.t["start_values"], chances, strict=True)}
        return self.rest(v, -1, belief, (0,) * 8 + (-1,), depth)

    def gate(self, x):
        return sigmoid(x / self.tau)

    def rest(self, v, reading, belief, memory, depth):
        if depth == 0:
            return 0.0
        return sum(
            chance * self.after(v, action, belief, remembered, depth)
            for chance, action, remembered in self.ways(v, reading, belief, list(memory))
        )

    def ways(self, v, reading, belief, memory):
        """(probability, action, memory): rock by rock, the nearest first. 0 open, 1 good, 2 done."""
        if memory[8] >= 0:
            memory[memory[8]] = 1 if self.d.observations[reading] == "good" else 2
            memory[8] = -1
        left, total = 1.0, sum(belief.values())
        for i in sorted(range(8), key=lambda i: (self.map.distance[v, i], i)):
            if memory[i] == 2:
                continue
            good = sum(p for x, p in belief.items() if x[i] == self.d.features[i][2]) / total
            walked, done = list(memory), self.map.toward[v, i] == self.map.sample
            walked[i] = 2 if done else memory[i]
            if self.word == "belief":
                chosen, go = self.gate(good - (1 - self.c)), self.gate(good - self.c)
                yield left * chosen * (1 - go), self.map.check + i, memory
            else:
                chosen, go = self.gate(self.map.accuracy[v, i] - self.c), float(memory[i] == 1)
                yield left * chosen * (1 - go), self.map.check + i, [*memory[:8], i]
            yield left * chosen * go, int(self.map.toward[v, i]), walked
            left *= 1 - chosen
        yield left, self.map.right, memory

    def after(self, v, action, belief, memory, depth):
        k, first = self.t["factor"][v * self.d.n_actions + action], self.t["first_row"][v * self.d.n_actions + action]
        total, branches, weight = 0.0, {}, sum(belief.values())
        for hidden, p in belief.items():
            row = first + (0 if k < 0 else hidden[k])
            for j in range(self.t["row_outcomes"][row], self.t["row_outcomes"][row + 1]):
                q = p * self.t["outcome_probability"][j] / weight
                total += q * self.t["outcome_reward"][0][j]
                vp = int(self.t["outcome_visible"][j])
                new = hidden if k < 0 else (*hidden[:k], int(self.t["outcome_value"][j]), *hidden[k + 1 :])
                for o, chance in enumerate(self.t["observation_probability"][self.t["outcome_observation"][j]]):
                    if chance > 0 and not self.t["terminal"][vp]:
                        branch = branches.setdefault((vp, o), {})
                        branch[new] = branch.get(new, 0.0) + q * chance
        for (vp, o), branch in branches.items():
            total += sum(branch.values()) * self.rest(vp, o, branch, memory, depth - 1)
        return total
