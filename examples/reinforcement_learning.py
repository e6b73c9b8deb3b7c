"""Agents of sb3-contrib on RockSample(7, 8), and their rows in the table of the harness.

    python examples/reinforcement_learning.py recurrent 1_000_000      # RecurrentPPO, environment steps
    python examples/reinforcement_learning.py masked 1_600_000         # MaskablePPO

``recurrent`` sees its last action and reading and must remember what the belief would tell it; ``masked`` is given the
belief and the legal actions. Leaving at once earns 10 for certain, and whoever has settled on it finds nothing else: so
the bonus for entropy begins high and falls.
"""

import sys

import numpy as np
import torch
from sb3_contrib import MaskablePPO, RecurrentPPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv

import harness
import harness.gym

DOMAIN = "rocksample-7x8"
OBSERVATIONS = {"recurrent": "action-reading", "masked": "belief"}
SCALE = 0.1  # of rewards: they are 10 and -100
ENTROPY = (0.5, 0.01)  # the bonus at the beginning, and from four fifths of the steps on


class Lanes(VecEnv):
    """The native vector environment as Stable-Baselines3 wants it: ends are told in a dictionary an environment."""

    def __init__(self, lanes, observation):
        self.env = harness.gym.PomdpVectorEnv(DOMAIN, lanes, observation=observation, autoreset_mode="SameStep")
        super().__init__(lanes, self.env.single_observation_space, self.env.single_action_space)

    def reset(self):
        seen, self.info = self.env.reset()  # without a seed: of the episodes that no evaluation plays
        return seen

    def step_async(self, actions):
        self.actions = actions

    def step_wait(self):
        seen, reward, ended, cut, self.info = self.env.step(self.actions)
        infos = [{} for _ in range(self.num_envs)]
        for e in np.flatnonzero(ended | cut):
            infos[e] = {"terminal_observation": self.info["final_obs"][e], "TimeLimit.truncated": bool(cut[e])}
        return seen, (SCALE * reward).astype(np.float32), ended | cut, infos

    def action_masks(self):
        return list(self.info["action_mask"])

    def env_method(self, method_name, *args, indices=None, **kwargs):
        return getattr(self, method_name)(*args, **kwargs)

    def get_attr(self, attr_name, indices=None):
        return [getattr(self if hasattr(type(self), attr_name) else self.env, attr_name)] * self.num_envs

    def set_attr(self, attr_name, value, indices=None):
        raise NotImplementedError(attr_name)

    def env_is_wrapped(self, wrapper_class, indices=None):
        return [False] * self.num_envs

    def close(self):
        self.env.close()


class Curve(BaseCallback):
    """Lowers the bonus for entropy, and scores the policy every so many steps."""

    def __init__(self, kind, every, episodes):
        super().__init__()
        self.kind, self.every, self.episodes, self.rows = kind, every, episodes, []

    def _on_step(self):
        return True

    def _on_rollout_start(self):
        done = min(1, (1 - self.model._current_progress_remaining) / 0.8)
        self.model.ent_coef = ENTROPY[0] * (ENTROPY[1] / ENTROPY[0]) ** done
        if not self.rows or self.num_timesteps >= self.rows[-1][0] + self.every:
            policy = policy_of(self.kind, self.model)
            result = harness.evaluate(DOMAIN, policy, episodes=self.episodes, seed=1, engine="tables", workers=1)
            self.rows.append((self.num_timesteps, result.score.mean))
            print(f"{self.num_timesteps:>10,} steps: return {result.score.mean:8.2f}", flush=True)


def policy_of(kind, model):
    name = {"recurrent": "recurrent PPO", "masked": "masked PPO"}[kind]
    return harness.AgentPolicy(model, observation=OBSERVATIONS[kind], legal=kind == "masked", name=name)


def made(kind, lanes):
    env = Lanes(lanes, OBSERVATIONS[kind])
    common = {"n_steps": 50, "n_epochs": 4, "learning_rate": 1e-3, "gamma": 0.97, "seed": 0, "device": "cpu"}
    common["batch_size"] = lanes * 50 // 4
    if kind == "masked":
        return MaskablePPO("MlpPolicy", env, policy_kwargs={"net_arch": [128, 128]}, **common)
    network = {"lstm_hidden_size": 64, "net_arch": [64], "shared_lstm": True, "enable_critic_lstm": False}
    return RecurrentPPO("MlpLstmPolicy", env, policy_kwargs=network, **common)


def train(kind, steps, lanes=256, every=100_000, episodes=1000):
    """The model, and (environment steps, mean return) along the way."""
    torch.set_num_threads(1)
    model = made(kind, lanes)
    curve = Curve(kind, every, episodes)
    model.learn(steps, callback=curve)
    return model, curve.rows


def main(kind, steps):
    model, _ = train(kind, steps)
    model.save(kind)
    print(f"{model.num_timesteps:,} environment steps")
    rows = [policy_of(kind, model), "sarsop", "solved", "thresholds", "ge", "ge-feedback", "exit"]
    print(harness.render(harness.compare(DOMAIN, rows, engine="tables")))


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
