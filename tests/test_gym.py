"""The Gymnasium environments: the harness's episodes, by Gymnasium's rules."""

from __future__ import annotations

import numpy as np
import pytest

import harness
from harness.engine import rng
from harness.engine.philox import uniform
from harness.errors import HarnessError
from harness.model.tables import compiled
from harness.policy.encoding import KINDS, Encoding
from tests import models

gymnasium = pytest.importorskip("gymnasium", reason="needs Gymnasium")

from gymnasium.utils.env_checker import check_env  # noqa: E402
from gymnasium.vector import AutoresetMode  # noqa: E402

import harness.gym as pomdp_gym  # noqa: E402
from harness.gym import vector as vectors  # noqa: E402

ROCKS = "pomdp_harness/RockSample-7x8-v1"
MODES = list(AutoresetMode)
SEED = 4  # of a policy that does many things on both domains, and is not always cut at the horizon


@compiled
def one_by_one(seed, stream, step, episode, out):
    for e in range(len(out)):
        out[e] = uniform(seed[e], stream, step[e], episode[e])


def test_a_number_of_one_episode_is_that_of_the_batch():
    """NumPy's own Philox is the reference."""
    draw = np.random.default_rng(0)
    seed = draw.integers(0, 2**64, 300, dtype=np.uint64)
    step, episode = draw.integers(0, 60, 300), draw.integers(0, 2**62, 300)
    seed[:2], episode[:9] = (0, 2**64 - 1), range(9)
    out = np.zeros(300)
    for stream in (0, 1, 2**31 - 1):
        one_by_one(seed, stream, step, episode, out)
        zipped = zip(seed.tolist(), step.tolist(), episode.tolist(), strict=True)
        assert out.tolist() == [rng.uniforms(s, stream, t, e, 1)[0] for s, t, e in zipped]


class Hashing:
    """A policy of nothing but what the environment shows, in whole numbers: the same on a batch of any size."""

    def __init__(self, domain, kind):
        self.encoding = Encoding(kind, domain)
        self.weights = np.random.default_rng(SEED).integers(0, 1000, self.encoding.size)
        self.n_actions = domain.n_actions

    def reset(self, batch):
        self.last = np.full(batch.size, -1, dtype=np.int32)

    def act(self, batch):
        self.last = self.choose(self.encoding(batch, self.last)).astype(np.int32)
        return self.last

    def choose(self, seen):
        found = (np.round(seen * 100).astype(np.int64) @ self.weights) % (self.n_actions + 2)
        return np.where(found < self.n_actions, found, 1)  # oftener to the right


def played(env, choose, episodes, seed, first=0):
    """(episodes,) returns and whether each terminated, by number, from a vector environment in any mode."""
    returns, terminated, found = np.zeros(episodes), np.zeros(episodes, dtype=bool), np.zeros(episodes, dtype=bool)
    seen, info = env.reset(seed=seed, options={"first": first})
    total, mode = np.zeros(env.num_envs), env.metadata["autoreset_mode"]
    while not found.all():
        number = info["episode_number"] - first
        seen, reward, ended, cut, info = env.step(choose(seen))
        assert not (ended & cut).any()
        total += reward
        over = ended | cut
        mine = over & (number < episodes)
        returns[number[mine]], terminated[number[mine]], found[number[mine]] = total[mine], ended[mine], True
        total[over] = 0
        if mode is AutoresetMode.DISABLED and over.any():
            seen, info = env.reset(options={"reset_mask": over})
    return returns, terminated


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", ["rocksample-7x8", "bordercross-7x8-random"])
@pytest.mark.parametrize("kind", ["belief", "action-reading"])
def test_the_episodes_are_those_of_evaluate(name, kind, mode):
    domain = harness.load(name)
    policy = Hashing(domain, kind)
    wanted = harness.evaluate(domain, policy, episodes=60, seed=3, first=5, horizon=20, engine="tables")
    assert len(set(wanted.returns)) > 2
    env = pomdp_gym.PomdpVectorEnv(domain, 7, observation=kind, horizon=20, autoreset_mode=mode)
    returns, terminated = played(env, policy.choose, 60, 3, 5)
    assert (returns == wanted.returns).all()
    assert (terminated == wanted.terminated).all()


def test_threads_and_lanes_change_nothing(rocksample, monkeypatch):
    policy = Hashing(rocksample, "belief")
    whole = played(pomdp_gym.PomdpVectorEnv(rocksample, 1, workers=1), policy.choose, 25, 0)
    monkeypatch.setattr(vectors, "_LEAST", 2)
    for mode in MODES:
        env = pomdp_gym.PomdpVectorEnv(rocksample, 11, workers=3, autoreset_mode=mode)
        assert len(env._parts) == 3
        for mine, wanted in zip(played(env, policy.choose, 25, 0), whole, strict=True):
            assert (mine == wanted).all()
        env.close()


def test_single_environments_play_the_same(rocksample):
    policy = Hashing(rocksample, "reading")
    wanted = harness.evaluate(rocksample, policy, episodes=6, seed=9, engine="tables")
    env = gymnasium.make(ROCKS, observation="reading")
    for k in range(6):
        seen, info = env.reset(seed=9) if k == 0 else env.reset()
        assert info["episode_number"] == k
        total, over = 0.0, False
        while not over:
            seen, reward, ended, cut, info = env.step(policy.choose(seen[None])[0])
            total, over = total + reward, ended or cut
        assert total == wanted.returns[k]
        assert ended == wanted.terminated[k]
    assert env.reset(seed=9, options={"first": 40})[1]["episode_number"] == 40


@pytest.mark.parametrize("name", harness.names())
def test_every_domain_is_registered_and_passes_gymnasium_s_checks(name):
    domain = harness.load(name)
    known = pomdp_gym.environment_id(domain)
    assert known.endswith(f"-v{domain.version}")
    for kind in KINDS:
        env = gymnasium.make(known, observation=kind).unwrapped
        assert env.domain == domain
        assert env.observation_space.shape == (len(env.encoding.names),)
        check_env(env, skip_render_check=kind != "reading" or name != "rocksample-7x8")


@pytest.mark.parametrize("mode", MODES)
def test_what_it_returns_is_what_gymnasium_s_own_returns(mode):
    """Up to the first ends, array by array, beside a SyncVectorEnv over single environments with the same episodes."""
    kwargs = {"observation": "action-reading", "horizon": 9}
    ours = gymnasium.make_vec(ROCKS, num_envs=4, autoreset_mode=mode, **kwargs)
    sync = gymnasium.make_vec(
        ROCKS, num_envs=4, vectorization_mode="sync", vector_kwargs={"autoreset_mode": mode}, **kwargs
    )
    assert ours.metadata["autoreset_mode"] is sync.metadata["autoreset_mode"] is mode
    for space in ("observation_space", "action_space", "single_observation_space", "single_action_space"):
        assert getattr(ours, space) == getattr(sync, space)
    sync.reset(seed=2)
    seen = ours.reset(seed=2)[0]
    assert (seen == [env.reset(seed=2, options={"first": e})[0] for e, env in enumerate(sync.envs)]).all()
    ours.action_space.seed(0)
    for step in range(9):
        actions = np.where([True, step % 2, 0, 0], 1, ours.action_space.sample())  # lane 0 leaves after 7
        mine, theirs = ours.step(actions), sync.step(actions)
        over = mine[2] | mine[3]
        for x, y in zip(mine[:4], theirs[:4], strict=True):
            assert (x.shape, x.dtype) == (y.shape, y.dtype)
            assert (x == y)[~over if mode is AutoresetMode.SAME_STEP else slice(None)].all()
        assert mine[4].keys() == theirs[4].keys()
        if over.any():
            break
    assert over.tolist() == [True, False, False, False]
    with_last = mode is AutoresetMode.SAME_STEP
    assert ("final_obs" in mine[4]) is with_last
    if with_last:
        assert (mine[4]["final_obs"][0] == theirs[4]["final_obs"][0]).all()
        assert mine[4]["final_obs"][1] is None
        for key in ("_final_obs", "_final_info"):
            assert mine[4][key].tolist() == theirs[4][key].tolist() == over.tolist()
        assert mine[4]["final_info"].keys() == theirs[4]["final_info"].keys()
        for key, value in mine[4]["final_info"].items():
            assert (value == theirs[4]["final_info"][key]).all()
    if mode is AutoresetMode.DISABLED:
        with pytest.raises(HarnessError, match="reset its lane first"):
            ours.step(actions)
    elif mode is AutoresetMode.NEXT_STEP:
        seen, reward, ended, cut, info = ours.step(actions)
        assert (reward[0], ended[0], cut[0]) == (0, False, False)
        assert info["episode_number"].tolist() == [4, 1, 2, 3]


def test_the_mask_is_what_is_legal_and_everything_once_over(rocksample):
    env = pomdp_gym.PomdpVectorEnv(rocksample, 2)
    mask = env.reset(seed=0)[1]["action_mask"]
    assert mask.dtype == np.int8
    assert [rocksample.actions[a] for a in np.flatnonzero(1 - mask[0])] == ["left()"]
    for _ in range(7):
        _, _, ended, _, info = env.step([1, 4])  # lane 0 walks out of the grid
    assert ended.tolist() == [True, False]
    assert info["action_mask"][0].all()


@pytest.mark.parametrize("mode", MODES[:2])
def test_gymnasium_s_own_statistics_are_of_the_same_episodes(rocksample, mode):
    """Its wrapper for vector environments reads ends and autoreset by itself."""
    policy = Hashing(rocksample, "belief")
    env = gymnasium.make_vec(ROCKS, num_envs=4, autoreset_mode=mode)
    env = gymnasium.wrappers.vector.RecordEpisodeStatistics(env)
    seen, info = env.reset(seed=6)
    found, number = {}, info["episode_number"]
    while len(found) < 12:
        seen, _, _, _, info = env.step(policy.choose(seen))
        if "episode" in info:
            over = info["_episode"]
            found |= dict(zip(number[over].tolist(), info["episode"]["r"][over].tolist(), strict=True))
        number = info["episode_number"]
    wanted = harness.evaluate(rocksample, policy, episodes=max(found) + 1, seed=6, engine="tables").returns
    assert [found[k] for k in found] == [wanted[k] for k in found]


def test_a_seed_of_nobody_s_choice_is_never_one_that_scores():
    env, other = (pomdp_gym.PomdpVectorEnv("rocksample-7x8", 3) for _ in range(2))
    for each in (env, other):
        each.reset()
        for part in each._parts:
            assert (part.lanes.seed >= rng.TRAINING).all()
            assert (part.lanes.seed < rng.REFINEMENT).all()
    assert env._parts[0].lanes.seed[0] != other._parts[0].lanes.seed[0]


def test_some_lanes_can_be_reset(rocksample):
    env = pomdp_gym.PomdpVectorEnv(rocksample, 3, autoreset_mode="Disabled")
    env.reset(seed=1)
    _, info = env.reset(seed=1, options={"reset_mask": np.array([False, True, False]), "first": 70})
    assert info["episode_number"].tolist() == [0, 71, 2]
    _, info = env.reset(options={"reset_mask": np.array([True, True, False])})
    assert info["episode_number"].tolist() == [3, 74, 2]
    assert env.reset()[1]["episode_number"].tolist() == [6, 77, 5]


@pytest.mark.parametrize("name", ["rocksample-7x8", "bordercross-7x8", "bordercross-7x8-random"])
def test_pictures_change_with_what_is_known(name):
    """By a text and by a picture, also where nothing is hidden, and after the end."""
    for mode in ("ansi", "rgb_array"):
        env = pomdp_gym.PomdpVectorEnv(name, 2, render_mode=mode)
        env.reset(seed=0)
        first = env.render()
        env.step([env.domain.n_actions - 1, 1])
        second = env.render()
        assert len(first) == len(second) == 2
        assert not np.array_equal(first[1], second[1])
        if mode == "ansi":
            assert "R" in first[0] or "1" in first[0]
        else:
            assert first[0].ndim == 3
            assert first[0].shape[2] == 3
            assert first[0].dtype == np.uint8
    single = pomdp_gym.PomdpEnv(name, render_mode="rgb_array", horizon=1)
    single.reset(seed=0)
    single.step(0)
    assert single.render().shape == first[0].shape
    assert pomdp_gym.PomdpEnv(name).render() is None


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: pomdp_gym.PomdpEnv("rocksample-7x9"), "did you mean 'rocksample-7x8'"),
        (lambda: pomdp_gym.PomdpEnv("rocksample-7x8", observation="belif"), "did you mean 'belief'"),
        (lambda: pomdp_gym.PomdpEnv("rocksample-7x8", render_mode="human"), "no render mode 'human'"),
        (lambda: pomdp_gym.PomdpEnv("rocksample-7x8", horizon=0), "horizon"),
        (lambda: pomdp_gym.PomdpVectorEnv("rocksample-7x8", 0), "num_envs"),
        (lambda: pomdp_gym.PomdpVectorEnv("rocksample-7x8", 2, autoreset_mode="Sometimes"), "known: NextStep"),
        (lambda: pomdp_gym.PomdpEnv("rocksample-7x8").step(0), "call reset"),
        (lambda: pomdp_gym.PomdpVectorEnv("rocksample-7x8", 2).step([0, 0]), "call reset"),
        (lambda: started(pomdp_gym.PomdpEnv("rocksample-7x8")).step(13), "0 to 12"),
        (lambda: started(pomdp_gym.PomdpVectorEnv("rocksample-7x8", 2)).step([0, 13]), "0 to 12"),
        (lambda: started(pomdp_gym.PomdpVectorEnv("rocksample-7x8", 2)).step([0.0, 1.0]), "2 action indices"),
        (lambda: started(pomdp_gym.PomdpVectorEnv("rocksample-7x8", 2)).step([0]), "2 action indices"),
        (lambda: pomdp_gym.PomdpEnv("rocksample-7x8").reset(seed=2**64), "seed"),
        (lambda: pomdp_gym.PomdpEnv("rocksample-7x8").reset(options={"first": -1}), "first"),
        (lambda: pomdp_gym.PomdpVectorEnv("rocksample-7x8", 2).reset(options={"reset_mask": [True]}), "2 booleans"),
    ],
)
def test_what_is_wrong_is_said_in_a_sentence(make, words):
    with pytest.raises(HarnessError, match=words):
        make()


def started(env):
    env.reset(seed=0)
    return env


def test_a_domain_of_one_s_own_is_an_environment(tmp_path):
    domain = models.tiger()
    env = gymnasium.make_vec(ROCKS, num_envs=3, domain=domain, render_mode="ansi")
    env.reset(seed=0)
    assert env.unwrapped.domain is domain
    env.step([0, 0, 0])
    assert "0." in env.render()[0]
    with pytest.raises(HarnessError, match="no layout to draw"):
        pomdp_gym.PomdpEnv(domain, render_mode="rgb_array")
