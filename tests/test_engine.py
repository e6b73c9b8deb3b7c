"""The tables engine against the slow references of tests/reference.py, episode by episode."""

from __future__ import annotations

import numpy as np
import pytest

from harness.engine import rng
from harness.engine.batch import Batch
from harness.play.evaluation import evaluate, simulate
from harness.policy.simple import RandomPolicy
from tests import reference

EPISODES = 300


class Tracking(RandomPolicy):
    """Random actions, with the belief kept."""

    uses_belief = True


def play(domain, seed, make):
    """Random episodes on the engine and on a slow reference side by side; yields what there is to compare."""
    slow = [make(u) for u in rng.uniforms(seed, rng.ENGINE, 0, 0, EPISODES)]
    for record in simulate(domain, Tracking(), "tables", seed, 0, EPISODES, 50):
        rewards = np.zeros(EPISODES)
        if record.actions is not None:
            u = rng.uniforms(seed, rng.ENGINE, record.batch.step, 0, EPISODES)
            rewards = np.array(
                [s.step(domain.actions[a], u_e) for s, a, u_e in zip(slow, record.actions, u, strict=True)]
            )
        yield slow, record, rewards


def test_rocksample_is_the_reference_episode_by_episode(rocksample):
    assert list(rocksample.actions) == reference.ACTIONS
    for slow, record, rewards in play(rocksample, 5, reference.RockSample):
        batch = record.batch
        assert np.array_equal(record.rewards, rewards)
        assert batch.done.tolist() == [s.done for s in slow]
        for e, s in enumerate(slow):
            if not s.done:
                assert tuple(rocksample.visible_values[batch.visible[e]]) == s.cell
                assert rocksample.observations[batch.observation[e]] == s.reading


@pytest.mark.parametrize("name", ["bordercross", "hidden"])
def test_bordercross_is_the_reference_episode_by_episode(name, request):
    domain = request.getfixturevalue(name)
    assert list(domain.actions) == reference.BorderCross.names
    for slow, record, rewards in play(domain, 6, lambda u: reference.BorderCross(u, hidden=name == "hidden")):
        batch = record.batch
        assert np.array_equal(record.rewards, rewards)
        assert batch.done.tolist() == [s.done for s in slow]
        assert [int(domain.observations[o]) for o in batch.observation] == [s.reading for s in slow]
        for e, s in enumerate(slow):
            visible = tuple(domain.visible_values[batch.visible[e]])
            assert visible == (s.robots[1] if name == "hidden" else s.robots[1] + s.robots[2])


def test_an_ended_episode_stays_as_it_is_and_is_paid_nothing(rocksample):
    class RightForever:
        def reset(self, batch):
            pass

        def act(self, batch):
            return np.ones(batch.size, dtype=int)

    records = [
        (r.rewards.copy(), r.batch.done.copy(), r.batch.visible.copy())
        for r in simulate(rocksample, RightForever(), "tables", 0, 0, 3, 50)
    ]
    assert len(records) == 8  # the reset and seven moves; nothing is stepped after that
    assert records[-1][0].tolist() == [10.0] * 3
    assert records[-1][1].all()


def test_stepping_past_the_end_changes_nothing(rocksample):
    from harness.engine.tables import TablesEngine

    engine = TablesEngine(rocksample, 4, True)
    engine.reset(rng.uniforms(0, rng.ENGINE, 0, 0, 4))
    right = np.ones(4, dtype=np.int32)
    for step in range(1, 8):
        engine.step(right, rng.uniforms(0, rng.ENGINE, step, 0, 4))
    assert engine.done.all()
    before = [a.copy() for a in (engine.visible, engine.observation, engine.marginals)]
    for action in range(rocksample.n_actions):
        assert not engine.step(right * action, rng.uniforms(0, rng.ENGINE, 9, 0, 4)).any()
    assert all(
        np.array_equal(a, b)
        for a, b in zip(before, (engine.visible, engine.observation, engine.marginals), strict=True)
    )


def test_episodes_do_not_depend_on_batches_or_workers(rocksample, monkeypatch):
    whole = evaluate(rocksample, "belief:0.84", episodes=2000, seed=3, engine="tables", workers=1)
    monkeypatch.setattr("harness.play.evaluation._BATCH", 171)
    split = evaluate(rocksample, "belief:0.84", episodes=2000, seed=3, engine="tables", workers=3)
    fewer = evaluate(rocksample, "belief:0.84", episodes=500, seed=3, engine="tables")
    assert np.array_equal(whole.returns, split.returns)
    assert np.array_equal(whole.discounted, split.discounted)
    assert np.array_equal(whole.returns[:500], fewer.returns)


def test_the_belief_is_only_kept_when_asked_for(rocksample):
    record = next(simulate(rocksample, RandomPolicy(), "tables", 0, 0, 5, 1))
    assert record.batch.marginals.shape == (5, 0)


def test_policies_cannot_write_to_the_engine(rocksample):
    class Vandal:
        def reset(self, batch):
            pass

        def act(self, batch):
            batch.done[:] = True
            return np.zeros(batch.size, dtype=int)

    with pytest.raises(ValueError, match="read-only"):
        evaluate(rocksample, Vandal(), episodes=10, engine="tables")


def test_a_policys_random_numbers_are_not_the_engines(rocksample):
    seen = []

    class Curious(RandomPolicy):
        def act(self, batch):
            seen.append((batch.step, np.stack([batch.uniform(0), batch.uniform(1)])))
            return super().act(batch)

    list(simulate(rocksample, Curious(), "tables", 0, 0, 50, 10))
    for step, numbers in seen:
        for other in range(12):
            engines = rng.uniforms(0, rng.ENGINE, other, 0, 50)
            assert not np.isin(numbers, engines).any(), step
    # Drawing more or less of them does not change an episode.
    greedy = evaluate(rocksample, Curious(), episodes=50, engine="tables")
    plain = evaluate(rocksample, "random", episodes=50, engine="tables")
    assert np.array_equal(greedy.returns, plain.returns)


@pytest.mark.parametrize("name", ["rocksample", "bordercross", "hidden"])
def test_legal_is_what_no_possible_value_forbids(name, request):
    """In every place, for beliefs that leave from one value to all of them possible; by the rows themselves."""
    domain = request.getfixturevalue(name)
    alive = np.flatnonzero(~domain.arrays["terminal"].astype(bool)).astype(np.int32)
    draw, seen = np.random.default_rng(0), set()
    for _ in range(3):
        possible = draw.random((len(alive), domain.n_marginals)) < draw.random((len(alive), 1))
        possible[:, domain.factor_offset[:-1]] |= draw.random() < 0.5
        blank = np.zeros(len(alive), dtype=np.int32)
        batch = Batch(domain, alive, blank, possible / 8, blank.astype(bool), 0, 0)
        found = batch.legal()
        for e, v in enumerate(alive):
            for a in range(domain.n_actions):
                wanted = all(allowed(domain, v * domain.n_actions + a, possible[e]))
                assert found[e, a] == wanted
                seen.add((domain.legality[v, a].item(), wanted))
    assert seen == {(1, True), (0, False)} | ({(-1, True), (-1, False)} if name == "hidden" else set())


def allowed(domain, choice, possible):
    """Whether it is legal, for each value of the relevant factor that is possible."""
    factor, first = domain.arrays["factor"][choice], domain.arrays["first_row"][choice]
    if factor < 0:
        return [domain.arrays["legal"][first]]
    start = domain.factor_offset[factor]
    values = range(domain.factor_sizes[factor])
    return [domain.arrays["legal"][first + x] for x in values if possible[start + x]]
