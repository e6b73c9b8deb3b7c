"""Milliseconds that POMCP takes over a first action of RockSample(7, 8), next to pomdp-py's, at the same simulations.

    python -m benchmarks.planners   # needs the extra `bench`

Both roll out by random legal actions, 90 steps at most, with the exploration constant 20, in one thread; the best of
several repetitions of each, in turn. The rocks of pomdp-py's own generator lie elsewhere, which changes no work.
"""

from __future__ import annotations

import random
import time
from collections.abc import Callable

from tabulate import tabulate

import harness
from harness import policy as policies
from harness.play.evaluation import simulate

DOMAIN = "rocksample-7x8"
REPETITIONS = 3
DEPTH, EXPLORATION, DISCOUNT = 90, 20.0, 0.95


def ours(simulations: int) -> Callable[[], object]:
    domain = harness.load(DOMAIN)
    planner = policies.make(f"pomcp:{simulations},rollout=legal", domain)[1]
    batch = next(simulate(domain, policies.make("random-legal", domain)[1], "tables", 0, 0, 1, 1)).batch

    def plan() -> None:
        planner.reset(batch)
        planner.act(batch)

    return plan


def pomdp_py(simulations: int) -> Callable[[], object]:
    import pomdp_py as peer
    from pomdp_py.problems.rocksample.rocksample_problem import RockSampleProblem, init_particles_belief

    random.seed(0)
    start, rocks = RockSampleProblem.generate_instance(7, 8)

    def plan() -> None:
        agent = RockSampleProblem(7, 8, start, rocks, init_particles_belief(8, 1000, start)).agent
        planner = peer.POMCP(
            max_depth=DEPTH, discount_factor=DISCOUNT, num_sims=simulations, exploration_const=EXPLORATION,
            rollout_policy=agent.policy_model, show_progress=False,
        )  # fmt: skip
        planner.plan(agent)

    return plan


def seconds(plans: list[Callable[[], object]]) -> list[float]:
    """The best time of each, taken in turn; one more before them compiles."""
    best = [float("inf")] * len(plans)
    for repetition in range(REPETITIONS + 1):
        for i, plan in enumerate(plans):
            started = time.perf_counter()
            plan()
            if repetition > 0:
                best[i] = min(best[i], time.perf_counter() - started)
    return best


def main() -> None:
    rows = []
    for simulations in (100, 1000):
        mine, theirs = seconds([ours(simulations), pomdp_py(simulations)])
        rows.append([f"{simulations:,}", f"{1000 * mine:.2f}", f"{1000 * theirs:.1f}", f"{theirs / mine:.0f}"])
    print(tabulate(rows, headers=["simulations", "ours (ms)", "pomdp-py (ms)", "ratio"], disable_numparse=True))


if __name__ == "__main__":
    main()
