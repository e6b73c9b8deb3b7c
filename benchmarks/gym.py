"""Steps a second of the vector environment, next to a loop of single ones and to a peer. One process, one run, ratios.

    make bench                      # or: python -m benchmarks.gym

Every row takes prepared random actions and resets what has ended. Ours give the exact belief and the action mask with
every step; the peer, RockSample(7, 8) of pobax in JAX, gives position and reading only, and is compiled as one loop of
100 steps. Its row is left out, with a line that says so, where it is missing:
`pip install pobax 'gymnax<0.0.9' sympy` beside the harness (tried with pobax 0.0.1, JAX 0.10 and gymnax 0.0.8).
"""

from __future__ import annotations

import argparse
import sys
import time
import types
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from gymnasium.vector import SyncVectorEnv
from tabulate import tabulate

import harness.gym
from benchmarks.steps import DOMAIN, REPETITIONS
from harness import host

ACTIONS, STEPS = 13, 100


class Rate(NamedTuple):
    """Steps a second, and steps a second of one core's work, which other work on the machine disturbs less."""

    wall: float
    core: float


def best(run: Callable[[], int]) -> Rate:
    """Of the best repetition; one more before them compiles."""
    run()
    found = []
    for _ in range(REPETITIONS):
        wall, core = time.perf_counter(), time.process_time()
        steps = run()
        found.append((steps / (time.perf_counter() - wall), steps / (time.process_time() - core)))
    return Rate(*(max(column) for column in zip(*found, strict=True)))


def prepared(lanes: int) -> np.ndarray:
    """(STEPS, lanes) random actions."""
    return np.random.default_rng(0).integers(0, ACTIONS, (STEPS, lanes))


def vector(lanes: int, mode: str, workers: int | None) -> Callable[[], int]:
    """The native vector environment."""
    env = harness.gym.PomdpVectorEnv(DOMAIN, lanes, autoreset_mode=mode, workers=workers)
    env.reset(seed=0)
    return stepping(env, prepared(lanes))


def looped(lanes: int) -> Callable[[], int]:
    """Gymnasium's own vector environment: a loop over single ones."""
    env = SyncVectorEnv([lambda: harness.gym.PomdpEnv(DOMAIN)] * lanes)
    env.reset(seed=0)
    return stepping(env, prepared(lanes))


def stepping(env, actions: np.ndarray) -> Callable[[], int]:
    def run() -> int:
        for each in actions:
            env.step(each)
        return actions.size

    return run


def single() -> Callable[[], int]:
    """One environment, reset when its episode ends."""
    env, actions = harness.gym.PomdpEnv(DOMAIN), prepared(1)[:, 0]
    env.reset(seed=0)

    def run() -> int:
        for action in actions:
            _, _, ended, cut, _ = env.step(action)
            if ended or cut:
                env.reset()
        return actions.size

    return run


def pobax_steps(lanes: int) -> Callable[[], int]:
    """pobax's RockSample(7, 8) under vmap and scan, on JAX's CPU device and all its threads."""
    import jax
    import pobax

    folder = Path(pobax.__file__).parent
    here = types.ModuleType("definitions")  # a module that its package names but does not hold
    here.ROOT_DIR = str(folder.parent)  # type: ignore[attr-defined]
    sys.modules.setdefault("definitions", here)
    jax.tree_map = jax.tree.map  # what gymnax 0.0.8 calls, and JAX has given another name
    from pobax.envs.jax.rocksample import RockSample

    env = RockSample(jax.random.PRNGKey(0), folder / "envs" / "configs" / "rocksample_7_8_config.json")
    parameters = env.default_params
    step = jax.vmap(env.step, in_axes=(0, 0, 0, None))

    def advance(state, given):
        key, actions = given
        seen, state, reward, done, _ = step(jax.random.split(key, lanes), state, actions, parameters)
        return state, (seen.sum(), reward.sum(), done.sum())  # so that nothing of a step is left out

    loop = jax.jit(lambda state, keys, actions: jax.lax.scan(advance, state, (keys, actions)))
    keys, actions = jax.random.split(jax.random.PRNGKey(1), STEPS), jax.numpy.asarray(prepared(lanes))
    _, state = jax.vmap(env.reset, in_axes=(0, None))(jax.random.split(keys[0], lanes), parameters)

    def run() -> int:
        jax.block_until_ready(loop(state, keys, actions))
        return actions.size

    return run


def rows(lanes: int, small: int) -> dict[str, Rate]:
    """Steps a second, by what takes them."""
    found = {
        f"vector, {lanes:,} lanes, NextStep": best(vector(lanes, "NextStep", None)),
        f"vector, {lanes:,} lanes, SameStep": best(vector(lanes, "SameStep", None)),
        f"vector, {lanes:,} lanes, NextStep, one thread": best(vector(lanes, "NextStep", 1)),
        f"vector, {small:,} lanes, NextStep": best(vector(small, "NextStep", None)),
        f"SyncVectorEnv, {small:,} single environments": best(looped(small)),
        "one single environment": best(single()),
    }
    try:
        found[f"pobax, {lanes:,} lanes, no belief"] = best(pobax_steps(lanes))
        found[f"pobax, {small:,} lanes, no belief"] = best(pobax_steps(small))
    except ImportError as error:
        print(f"pobax is not installed ({error}): its rows are left out.")
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--lanes", type=int, default=16_384)
    parser.add_argument("--few", type=int, default=64)
    options = parser.parse_args()
    found = rows(options.lanes, options.few)
    loop = next(rate for name, rate in found.items() if name.startswith("SyncVectorEnv"))
    peers = [rate for name, rate in found.items() if name.startswith("pobax")]
    against = {"loop": loop} | ({"pobax": Rate(*map(max, zip(*peers, strict=True)))} if peers else {})
    table = [
        [name, f"{rate.wall:,.0f}", f"{rate.core:,.0f}", *ratios(rate, against.values())]
        for name, rate in found.items()
    ]
    headers = [f"{DOMAIN}, {host.workers(None)} cores", "steps/s", "a core-second"]
    headers += [f"× {name}{clock}" for name in against for clock in ("", ", core")]
    print(tabulate(table, headers=headers, disable_numparse=True, colalign=("left", *["right"] * (len(headers) - 1))))


def ratios(rate: Rate, peers: Iterable[Rate]) -> list[str]:
    return [f"{mine / other:,.2f}" for peer in peers for mine, other in zip(rate, peer, strict=True)]


if __name__ == "__main__":
    main()
