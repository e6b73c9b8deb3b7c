"""Milliseconds that POMCP takes over a first action of RockSample(7, 8), next to pomdp-py's, at the same simulations.

    python -m benchmarks.planners           # needs the extra `bench`
    python -m benchmarks.planners --julia   # needs Julia with BasicPOMCP, ARDESPOT, AdaOPS and DiscreteValueIteration

Both roll out by random legal actions, 90 steps at most, with the exploration constant 20, in one thread; the best of
several repetitions of each, in turn. The rocks of pomdp-py's own generator lie elsewhere, which changes no work.

With --julia whole episodes are played, and each planner of POMDPs.jl stands beside ours of the same settings: what both
earn, and the processor's time an action. AdaOPS has no counterpart. After an episode that compiles. BasicPOMCP is given
the exact belief, as ours is. By itself it rolls out by all actions, illegal ones too, and tries them in its tree;
here it has the legal ones, as ours has, and ours makes a new tree at every step, as it does.
"""

from __future__ import annotations

import argparse
import random
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tabulate import tabulate

import harness
from harness import policy as policies
from harness.engine.batch import Batch
from harness.play.evaluation import evaluate, simulate
from harness.policy.planner import pomcp

DOMAIN = "rocksample-7x8"
REPETITIONS = 3
DEPTH, EXPLORATION, DISCOUNT = 90, 20.0, 0.95

_JULIA_BOUNDS = """
solved(m) = solve(SparseValueIterationSolver(), UnderlyingMDP(m))
leave(m) = FunctionPolicy(_ -> actions(m)[2])
"""
PEERS = {
    "BasicPOMCP": (
        """using BasicPOMCP, PomdpHarness, POMDPs, POMDPTools
        POMDPs.actions(m::RockSample, b::BasicPOMCP.LeafNodeBelief) = actions(m, b.sp)
        POMCPSolver(tree_queries = 1000, c = 20.0, max_depth = 90,
            estimate_value = FORollout(RandomSolver())) => belief_updater""",
        "pomcp:1000,rollout=legal,exploration=20",
    ),
    "BasicPOMCP, all actions": (
        "using BasicPOMCP, PomdpHarness\nPOMCPSolver(tree_queries = 1000, c = 20.0, max_depth = 90) => belief_updater",
        "pomcp:1000,rollout=legal,exploration=20",
    ),
    "ARDESPOT": (
        "using ARDESPOT, POMDPs, POMDPTools, DiscreteValueIteration"
        + _JULIA_BOUNDS
        + """m -> DESPOTSolver(K = 100, max_trials = 30, T_max = Inf, lambda = 0.01, bounds_warnings = false,
            default_action = actions(m)[2],
            bounds = IndependentBounds(DefaultPolicyLB(leave(m)), FullyObservableValueUB(solved(m)),
                check_terminal = true, consistency_fix_thresh = 1e-3))""",
        "despot:100,trials=30,lambda=0.01",
    ),
    "AdaOPS": (
        "using AdaOPS, POMDPs, POMDPTools, DiscreteValueIteration"
        + _JULIA_BOUNDS
        + """m -> AdaOPSSolver(max_trials = 30, T_max = Inf, default_action = actions(m)[2],
            bounds = AdaOPS.IndependentBounds(
            FORollout(leave(m)), FOValue(solved(m)), check_terminal = true, consistency_fix_thresh = 1e-3))""",
        None,
    ),
}
"""Julia file of each planner of POMDPs.jl, and ours of the same settings."""


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


def beside_pomdp_py() -> None:
    rows = []
    for simulations in (100, 1000):
        mine, theirs = seconds([ours(simulations), pomdp_py(simulations)])
        rows.append([f"{simulations:,}", f"{1000 * mine:.2f}", f"{1000 * theirs:.1f}", f"{theirs / mine:.0f}"])
    print(tabulate(rows, headers=["simulations", "ours (ms)", "pomdp-py (ms)", "ratio"], disable_numparse=True))


class Forgetful(pomcp.POMCPPolicy):
    """POMCP with a new tree at every step."""

    def act(self, batch: Batch) -> NDArray[np.int32]:
        self._used[:] = 0
        return super().act(batch)


def policy_of(spec: str, domain: harness.Domain) -> harness.Policy:
    made = policies.make(spec, domain)[1]
    if isinstance(made, pomcp.POMCPPolicy):
        made.__class__ = Forgetful
    return made


def played(spec: str, engine: str, episodes: int) -> tuple[str, float]:
    """What a policy earns, and its milliseconds an action; the clock starts when it is made and compiled."""
    domain = harness.load(DOMAIN)
    policy = policy_of(spec, domain)
    settings = {"horizon": 90, "engine": engine, "workers": 1}
    evaluate(domain, policy, episodes=1, seed=1, **settings)
    started = time.process_time()
    found = evaluate(domain, policy, episodes=episodes, seed=2, **settings)
    took = 1000 * (time.process_time() - started) / found.steps.sum()
    return f"{found.score.discounted_mean:.2f} ± {found.score.discounted_sem:.2f}", took


def beside_julia(episodes: int) -> None:
    rows = []
    for name, (source, spec) in PEERS.items():
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"{name}.jl"
            path.write_text(source, encoding="utf-8")
            theirs, their_time = played(str(path), "julia", episodes)
        mine, my_time = played(spec, "tables", episodes) if spec else ("", None)
        ratio = f"{their_time / my_time:.1f}" if my_time else ""
        rows.append([name, theirs, f"{their_time:.1f}", spec or "", mine, f"{my_time:.1f}" if my_time else "", ratio])
        print(name, *rows[-1][1:], flush=True)
    print(tabulate(rows, headers=["planner", "earns", "ms", "ours", "earns", "ms", "ratio"], disable_numparse=True))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--julia", action="store_true", help="beside planners of POMDPs.jl")
    parser.add_argument("--episodes", type=int, default=50, help="of each planner, with --julia")
    given = parser.parse_args()
    if given.julia:
        beside_julia(given.episodes)
    else:
        beside_pomdp_py()


if __name__ == "__main__":
    main()
