"""Environment steps and belief updates a second, next to what else there is. One process, one run, as ratios.

    make bench                      # or: python benchmarks/steps.py

Rows that need Julia or pomdp-py are left out, with a line that says so, where these are missing. Every rate is the
best of several repetitions: other work on the machine only ever makes one slower.
"""

from __future__ import annotations

import random
import time
from collections.abc import Callable

import numpy as np
from tabulate import tabulate

import harness
from harness import bridge

DOMAIN = "rocksample-7x8"
REPETITIONS = 5
ROLLOUT_POLICIES = {
    "POMDPTools' RandomPolicy": "(m, rng) -> RandomPolicy(m; rng)",
    "a typed random policy": "(m, rng) -> FunctionPolicy(let as = actions(m); _ -> rand(rng, as); end)",
}
"""The peer as users write it, and at its best."""
HEADINGS = {
    "RolloutSimulator, POMDPTools' RandomPolicy": "RandomPolicy",
    "RolloutSimulator, a typed random policy": "typed",
    "pomdp-py, random": "pomdp-py",
}


def best_rate(run: Callable[[], int]) -> float:
    """Steps a second of the best repetition; one more before them compiles."""
    run()
    rates = []
    for _ in range(REPETITIONS):
        started = time.perf_counter()
        steps = run()
        rates.append(steps / (time.perf_counter() - started))
    return max(rates)


def engine_steps(engine: str, policy: str, episodes: int) -> Callable[[], int]:
    """Steps of whole evaluations: policy, engine, random numbers and the summing up of returns."""

    def run() -> int:
        return int(harness.evaluate(DOMAIN, policy, episodes=episodes, engine=engine).steps.sum())

    return run


def rollout_simulator(policy: str) -> Callable[[], int]:
    """POMDPTools' RolloutSimulator with random actions, inside Julia, on one thread.

    ``policy`` is Julia code: (model, generator) -> policy. The model is ours.
    """
    simulate = bridge.julia().seval(
        f"""begin
            (m, n) -> begin
                simulator = RolloutSimulator(; max_steps = 50, rng = Random.MersenneTwister(2))
                policy = ({policy})(m, Random.MersenneTwister(1))
                for _ in 1:n
                    simulate(simulator, m, policy, NothingUpdater())
                end
            end
        end"""
    )
    model = bridge.model(harness.load(DOMAIN))
    episodes = 20_000
    steps = harness.evaluate(DOMAIN, "random", episodes=100_000, engine="tables").score.steps_mean

    def run() -> int:
        simulate(model, episodes)
        return round(episodes * steps)  # the same model and policy: the same mean length

    return run


def call_by_call() -> Callable[[], int]:
    """Stepping through juliacall, one call a step."""
    jl = bridge.julia()
    step = jl.seval("(m, s, a, rng) -> @gen(:sp, :o, :r)(m, s, a, rng)")
    start = jl.seval("(m, rng) -> rand(rng, initialstate(m))")
    ended = jl.seval("(m, s) -> isterminal(m, s)")
    generator = jl.seval("Random.MersenneTwister(1)")
    model = bridge.model(harness.load(DOMAIN))

    def run() -> int:
        done = 0
        while done < 5000:
            state = start(model, generator)
            for _ in range(50):
                state, _, _ = step(model, state, random.randint(1, 13), generator)
                done += 1
                if ended(model, state):
                    break
        return done

    return run


def pomdp_py_steps() -> Callable[[], int]:
    """pomdp-py's RockSample(7, 8) as its examples step it: environment, observation, random actions; no belief."""
    from pomdp_py.problems.rocksample.rocksample_problem import RockSampleProblem, init_particles_belief

    start, rocks = RockSampleProblem.generate_instance(7, 8)
    problem = RockSampleProblem(7, 8, start, rocks, init_particles_belief(8, 10, start))
    actions = list(problem.agent.policy_model.get_all_actions())
    environment, model = problem.env, problem.agent.observation_model

    def run() -> int:
        done = 0
        while done < 50_000:
            environment.apply_transition(start)
            for _ in range(50):
                action = random.choice(actions)
                environment.state_transition(action, execute=True)
                environment.provide_observation(model, action)
                done += 1
                if environment.state.terminal:
                    break
        return done

    return run


def belief_updates(updater: str, updates: int) -> Callable[[], int]:
    """Exact belief updates after checks in RockSample(7, 8), inside Julia, on one thread."""
    many = bridge.julia().seval(
        f"""(m, n) -> begin
            up = {updater}(m)
            run(up, b) = (for i in 1:n; b = update(up, b, check(1 + i % 8), isodd(i) ? :good : :bad); end; b)
            run(up, initialize_belief(up, initialstate(m)))
            return n
        end"""
    )
    model = bridge.model(harness.load(DOMAIN))
    return lambda: many(model, updates)


def print_beliefs() -> None:
    ours, flat = (
        best_rate(belief_updates("FactoredUpdater", 200_000)),
        best_rate(belief_updates("DiscreteUpdater", 500)),
    )
    rows = [["FactoredUpdater", f"{ours:,.0f}", f"{ours / flat:,.0f}"], ["DiscreteUpdater", f"{flat:,.0f}", "1"]]
    headers = [f"{DOMAIN}", "belief updates/s", "× DiscreteUpdater"]
    print("\n" + tabulate(rows, headers=headers, disable_numparse=True, colalign=("left", "right", "right")))


def main() -> None:
    rates = {
        "tables, random": best_rate(engine_steps("tables", "random", 400_000)),
        "tables, belief:0.84": best_rate(engine_steps("tables", "belief:0.84", 200_000)),
    }
    if bridge.is_set_up():
        threads = bridge.julia().seval("Threads.nthreads()")
        rates["julia, random"] = best_rate(engine_steps("julia", "random", 400_000))
        rates["julia, belief:0.84"] = best_rate(engine_steps("julia", "belief:0.84", 200_000))
        for name, policy in ROLLOUT_POLICIES.items():
            rates[f"RolloutSimulator, {name}"] = best_rate(rollout_simulator(policy))
        rates["juliacall, one call a step, random"] = best_rate(call_by_call())
        print(f"Julia runs {threads} threads; RolloutSimulator uses one of them.")
    else:
        print("No Julia is set up (see `harness julia`): its rows are left out.")
    try:
        rates["pomdp-py, random"] = best_rate(pomdp_py_steps())
    except ImportError:
        print("pomdp-py is not installed (pip install 'pomdp-harness[bench]'): its row is left out.")
    peers = [name for name in rates if "RandomPolicy" in name or "typed" in name or name.startswith("pomdp-py")]
    rows = [
        [name, f"{rate:,.0f}", *(f"{rate / rates[peer]:,.2f}" for peer in peers)]
        for name, rate in sorted(rates.items(), key=lambda item: -item[1])
    ]
    headers = [f"{DOMAIN}", "steps/s", *(f"× {HEADINGS[peer]}" for peer in peers)]
    print(tabulate(rows, headers=headers, disable_numparse=True, colalign=("left", *["right"] * (1 + len(peers)))))
    if bridge.is_set_up():
        print_beliefs()


if __name__ == "__main__":
    np.random.seed(0)  # noqa: NPY002  pomdp-py draws from the global generators
    random.seed(0)
    main()
