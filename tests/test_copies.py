"""Copies of policies: nothing is shared between batches that are played at the same time, and nothing left behind."""

from __future__ import annotations

import copy
import threading
import time
from typing import ClassVar

import numpy as np
import pytest

import harness
from harness import policy as policies
from harness.cli import main
from harness.engine.batch import Batch
from harness.errors import PolicyError
from harness.play import evaluation
from harness.play.conformance import ConformanceError, check_policy
from harness.play.evaluation import evaluate, simulate
from harness.policy import heuristic
from harness.policy.program import ProgramPolicy
from harness.program import parse, words_of


class Memory:
    """What a recurrent policy keeps in an object of its own."""


class Recurrent:
    """Decides by a hidden state, which lies in a sub-object as a network's does."""

    def __init__(self):
        self.memory = Memory()

    def reset(self, batch):
        self.memory.hidden = np.zeros(batch.size)

    def act(self, batch):
        self.memory.hidden = np.tanh(0.9 * self.memory.hidden + batch.features.sum(axis=1) - 3 - batch.visible % 3)
        return (np.abs(self.memory.hidden) * 10_000).astype(int) % batch.domain.n_actions


class Drawing(Recurrent):
    """Draws from a generator of its own."""

    def __init__(self):
        super().__init__()
        self.memory.rng = np.random.default_rng(0)

    def act(self, batch):
        return self.memory.rng.integers(0, 4, batch.size)


class Locked(Recurrent):
    """Cannot be copied."""

    def __init__(self):
        super().__init__()
        self.lock = threading.Lock()


class Cloned(Locked):
    """Cannot be deep-copied, but knows how to make another."""

    def clone(self):
        return Cloned()


class Shared(Recurrent):
    """Its copies share one memory, whatever is done."""

    common = Memory()

    def __init__(self):
        pass

    memory = property(lambda self: Shared.common)


class Wrapping:
    """A shipped policy inside a user's."""

    def __init__(self, policy):
        self.inner = policy

    def reset(self, batch):
        self.inner.reset(batch)

    def act(self, batch):
        return self.inner.act(batch)


def returns(domain, policy, workers, episodes=600):
    return evaluate(domain, policy, episodes=episodes, engine="tables", workers=workers).returns


@pytest.fixture
def small_batches(monkeypatch):
    monkeypatch.setattr("harness.play.evaluation._BATCH", 50)


@pytest.mark.usefixtures("small_batches")
class TestThreads:
    @pytest.mark.parametrize("policy", [Recurrent, Drawing, Cloned])
    def test_any_object_scores_the_same_on_any_number(self, rocksample, policy):
        one = returns(rocksample, policy(), 1)
        assert len(set(one)) > 1
        for workers in (2, 5):
            assert np.array_equal(returns(rocksample, policy(), workers), one)

    def test_a_wrapped_policy_scores_like_itself(self, rocksample):
        for spec in ("belief:0.84", "accuracy:0.93", "ge-feedback"):
            inside = Wrapping(policies.make(spec, rocksample)[1])
            assert np.array_equal(returns(rocksample, inside, 4), returns(rocksample, spec, 1))

    def test_what_cannot_be_copied_plays_in_one_and_says_so(self, rocksample):
        with pytest.warns(
            UserWarning, match=r"Locked cannot be copied \(TypeError: .*\): it plays in one thread"
        ) as told:
            many = returns(rocksample, Locked(), 4)
        assert len({str(warning.message) for warning in told}) == 1
        assert "\n" not in str(told[0].message)
        assert len(str(told[0].message)) < 300
        assert np.array_equal(many, returns(rocksample, Recurrent(), 1))

    def test_a_clone_that_is_no_policy_is_told(self, rocksample):
        class Wrong(Recurrent):
            def clone(self):
                return None

        with pytest.warns(
            UserWarning, match=r"Wrong cannot be copied \(TypeError: clone\(\) returned a NoneType\): it plays"
        ):
            returns(rocksample, Wrong(), 2)


class Itself(Recurrent):
    """Says that it is its own copy."""

    def __deepcopy__(self, memo):
        return self


class ItselfCloned(Recurrent):
    def clone(self):
        return self


class Sharing(Wrapping):
    """Its copies share the shipped policy inside, which is not to be noticed from outside."""

    def __deepcopy__(self, memo):
        return Sharing(self.inner)


class TestSharedOnPurpose:
    @pytest.mark.parametrize("policy", [Itself, ItselfCloned])
    @pytest.mark.usefixtures("small_batches")
    def test_who_is_its_own_copy_plays_in_one_thread_and_says_so(self, rocksample, policy):
        with pytest.warns(
            UserWarning, match=r"cannot be copied \(TypeError: its copy is the policy itself\): it plays"
        ):
            many = returns(rocksample, policy(), 4)
        assert np.array_equal(many, returns(rocksample, Recurrent(), 1))
        with pytest.raises(PolicyError, match="its copy is the policy itself"):
            check_policy(policy(), rocksample)

    def test_arrays_of_another_thread_are_refused_or_fit(self, rocksample, monkeypatch):
        """Batches of 50 and of 7, all on the same arrays, again and again: nothing is written past any of them."""
        monkeypatch.setattr("harness.play.evaluation._BATCH", 50)
        for spec in ("belief:0.84", "accuracy:0.93", "ge-feedback") * 5:
            shared = Sharing(policies.make(spec, rocksample)[1])
            try:
                played = returns(rocksample, shared, 8, episodes=607)
            except PolicyError as error:
                assert "episodes after a reset() for" in str(error)  # noqa: PT017  either is right
            else:
                assert np.isfinite(played).all()

    def test_actions_that_change_after_they_were_checked_do_not_reach_the_engine(self, rocksample):
        class Late(Recurrent):
            def reset(self, batch):
                self.actions = np.zeros(batch.size, dtype=np.int32)

            def act(self, batch):
                return self.actions

        batch = TestSizes.batch(rocksample, 3)
        policy = Late()
        policy.reset(batch)
        taken = evaluation.checked(policy.act(batch), batch)
        policy.actions[:] = 2**30
        assert taken.tolist() == [0, 0, 0]


@pytest.mark.usefixtures("small_batches")
def test_ctrl_c_while_batches_are_handed_out_stops_those_under_way(rocksample, monkeypatch):
    submit, handed, acts = evaluation.ThreadPoolExecutor.submit, [], threading.Event()

    class Endless(Recurrent):
        def act(self, batch):
            acts.set()
            return np.zeros(batch.size, dtype=int)

    def interrupted(pool, *what):
        handed.append(1)
        if len(handed) == 3:
            acts.wait()
            raise KeyboardInterrupt
        return submit(pool, *what)

    monkeypatch.setattr(evaluation.ThreadPoolExecutor, "submit", interrupted)
    with pytest.raises(KeyboardInterrupt):
        evaluate(rocksample, Endless(), episodes=200, horizon=10**8, engine="tables", workers=2)
    acts.clear()
    assert not acts.wait(1)


def test_the_batches_do_not_depend_on_the_threads(rocksample):
    """Also where nothing is set small: a generator of a policy's own starts again in every batch."""
    assert np.array_equal(*(returns(rocksample, Drawing(), workers, 6000) for workers in (1, 3)))


def test_replays_and_drawings_leave_the_object_alone(rocksample):
    policy = Recurrent()
    list(harness.replay(rocksample, policy, engine="tables"))
    harness.draw_episode(rocksample, policy, engine="tables")
    list(simulate(rocksample, policy, "tables", 0, 0, 3, 5))
    assert not hasattr(policy.memory, "hidden")


def test_copies_share_what_never_changes(rocksample):
    for spec in ("sarsop", "ge", "belief:0.9"):
        policy = policies.make(spec, rocksample)[1]
        shared = [name for name, value in vars(copy.deepcopy(policy)).items() if value is vars(policy)[name]]
        assert {"_vectors", "program", "map"} & set(shared)
    assert copy.deepcopy([rocksample])[0] is rocksample


class TestCheckPolicy:
    @pytest.mark.parametrize("spec", ["random", "random-legal", "rollout:1", "accuracy:0.93", "belief:0.84"])
    def test_shipped_policies_pass(self, rocksample, spec):
        check_policy(spec, rocksample, episodes=40)

    @pytest.mark.parametrize("domain", ["rocksample-7x8", "bordercross-7x8", "bordercross-7x8-random"])
    def test_all_that_a_table_shows_pass(self, domain):
        loaded = harness.load(domain)
        for spec in policies.default_specs(loaded):
            if not spec.startswith("rollout"):
                check_policy(spec, loaded, episodes=20, horizon=20)

    @pytest.mark.parametrize("policy", [Recurrent, Cloned])
    def test_memory_in_an_object_passes_and_stays_untouched(self, rocksample, policy):
        mine = policy()
        harness.check_policy(mine, "rocksample-7x8", episodes=60)
        assert not hasattr(mine.memory, "hidden")

    def test_a_generator_of_its_own_shows_in_every_cut(self, rocksample):
        with pytest.raises(ConformanceError) as error:
            check_policy(Drawing(), rocksample, episodes=60)
        text = str(error.value)
        assert text.startswith("Drawing acts otherwise in batches of 7 (")
        for way in ("1 (", "7 on 4 threads (", "15 (", "15 on 4 threads ("):
            assert f", {way}" in text
        assert "draw by batch.uniform()" in text
        assert len(text) < 300

    def test_memory_that_outlives_a_copy_shows(self, rocksample):
        class Counting(Recurrent):
            calls: ClassVar = [0]

            def act(self, batch):
                self.calls[0] += 1
                return np.full(batch.size, self.calls[0] % 2)

        with pytest.raises(ConformanceError, match=r"in batches of 40 \(40 of 40\)"):
            check_policy(Counting(), rocksample, episodes=40, horizon=7)

    def test_memory_that_copies_share_shows(self, rocksample):
        class Yielding(Shared):
            def act(self, batch):
                actions = super().act(batch)
                time.sleep(1e-4)  # here the other threads go on
                return actions

        with pytest.raises(ConformanceError, match=r"of 7 on 4 threads .*, 5 on 4 threads"):
            check_policy(Yielding(), rocksample, episodes=20)

    def test_an_error_in_some_batch_is_a_breach(self, rocksample):
        class Fixed(Recurrent):
            def act(self, batch):
                return np.zeros(batch.size, dtype=int) + np.zeros(20, dtype=int)

        with pytest.raises(ConformanceError, match=r"of 7 \(a ValueError\), 1 \(a PolicyError\)"):
            check_policy(Fixed(), rocksample, episodes=20)

    def test_who_left_must_stay_away(self, rocksample):
        class Wavering(Recurrent):
            def act(self, batch):
                return np.full(batch.size, -1 if batch.step == 2 else 0) * (np.arange(batch.size) == 3)

        with pytest.raises(ConformanceError, match="Wavering goes on in episode 3, which it had left by -1"):
            check_policy(Wavering(), rocksample, episodes=20)

    def test_what_cannot_be_copied_is_refused(self, rocksample):
        with pytest.raises(PolicyError, match="Locked cannot be copied"):
            check_policy(Locked(), rocksample)

    def test_the_command(self, capsys, monkeypatch):
        assert main(["check-policy", "rocksample-7x8", "exit", "--episodes", "30"]) == 0
        assert capsys.readouterr().out == "exit on rocksample-7x8: all checks passed\n"
        monkeypatch.setattr(
            "harness.policy.simple.RandomPolicy.act",
            lambda _, batch: np.random.default_rng().integers(0, 4, batch.size),
        )
        assert main(["check-policy", "rocksample-7x8", "random", "--episodes", "30"]) == 1
        assert capsys.readouterr().out.startswith("random acts otherwise in batches of 30 (")


class TestSizes:
    """What compiled code writes to or reads must be as large as the batch; elsewhere nobody would notice."""

    @staticmethod
    def batch(domain, size, belief=True):
        marginals = np.full((size, domain.n_marginals if belief else 0), 0.5)
        zeros = np.zeros(size, dtype=np.int32)
        return Batch(domain, zeros, zeros, marginals, np.zeros(size, dtype=np.bool_), seed=0, first=0)

    @pytest.mark.parametrize("spec", ["accuracy:0.93", "belief:0.84", "ge-feedback"])
    def test_arrays_of_another_batch_are_refused(self, rocksample, spec):
        policy = policies.make(spec, rocksample)[1]
        policy.reset(self.batch(rocksample, 3))
        with pytest.raises(PolicyError, match=r"given 4 episodes after a reset\(\) for 3: call reset"):
            policy.act(self.batch(rocksample, 4))

    @pytest.mark.parametrize("spec", ["belief:0.84", "thresholds", "rollout:1", "random-legal", "sarsop", "program"])
    def test_a_belief_that_was_left_out_is_missed(self, rocksample, spec):
        program = parse("if(belief(1) > 0.4) up()", words_of(rocksample))
        policy = ProgramPolicy(program) if spec == "program" else policies.make(spec, rocksample)[1]
        batch = self.batch(rocksample, 3, belief=False)
        policy.reset(batch)
        with pytest.raises(PolicyError, match="the belief was left out"):
            policy.act(batch)

    @pytest.mark.parametrize("spec", ["accuracy:0.93", "belief:0.84", "thresholds"])
    def test_rocks_of_another_domain_are_refused(self, rocksample, spec):
        policy = policies.make(spec, rocksample)[1]
        with pytest.raises(PolicyError, match="made for other rocks than those of rocksample-11x11"):
            evaluate("rocksample-11x11", policy, episodes=10, engine="tables")

    def test_a_program_of_another_domain_is_refused(self, rocksample):
        policy = policies.make("ge", rocksample)[1]
        with pytest.raises(PolicyError, match="compiled for rocksample-7x8, not for bordercross-7x8"):
            evaluate("bordercross-7x8", policy, episodes=10, engine="tables")

    def test_the_map_itself_is_what_passes(self, rocksample):
        made = heuristic.rock_map(rocksample)
        assert made.of(rocksample) is made
