"""Does tuning the constants of programs in the course of their evolution pay, where constants matter?

    python -m benchmarks.constants [SEEDS [MILLION_STEPS]]

Plain evolution against evolution whose best programs' constants are tuned every few generations, by lines and by
autodiff, on RockSample(7, 8) with worse sensors: half-efficiency distances of 2 and 5, and one that is never right with
more than 0.8. The same seeds, so the same first populations, and as many environment steps (situations of autodiff
count as such). Returns are exact, of the best of the last generation's twenty on episodes that it has not seen.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from itertools import islice

import numpy as np
from numpy.typing import NDArray
from tabulate import tabulate

import harness
from harness.expectation.programs import expected
from harness.ge import loop
from harness.ge.defaults import grammar_for
from harness.ge.fitness import ProgramFitness
from harness.ge.parameters import Parameters
from harness.ge.refinement import Refiner
from harness.model.domain import Domain

SHARED = {
    "population": 100, "generations": 10_000, "episodes": 100, "tournament": 5, "crossover": "subtree",
    "mutation": "structural", "mutation_probability": 0.5, "max_init_depth": 12,
}  # fmt: skip
ARMS: dict[str, dict[str, object]] = {
    "plain": {},
    "lines": {"refine": 3, "refine_every": 5},
    "autodiff": {"refine": 3, "refine_every": 5, "tuner": "autodiff"},
}
SENSORS = {"d0 = 2": (2.0, 1.0), "d0 = 5": (5.0, 1.0), "at most 0.8": (20.0, 0.8)}
ROOM = 20_000  # situations of one step


def with_sensor(domain: Domain, half: float, best: float) -> Domain:
    """A RockSample domain whose readings are right with min(best, 0.5 + 0.5 · 2^(−d / half)) at the distance d."""
    before, layout = domain.layout["half_efficiency_distance"], {**domain.layout, "half_efficiency_distance": half}
    readings = domain.arrays["observation_probability"].copy()
    telling = readings[:, domain.observations.index("none")] == 0.0
    right = np.minimum(best, 0.5 + 0.5 * (2 * readings[telling].max(axis=1) - 1) ** (before / half))
    good = domain.observations.index("good"), domain.observations.index("bad")
    first = readings[telling, good[0]] >= readings[telling, good[1]]
    readings[telling, good[0]] = np.where(first, right, 1 - right)
    readings[telling, good[1]] = 1 - readings[telling, good[0]]
    arrays = {**domain.arrays, "observation_probability": readings, "observation_cdf": np.cumsum(readings, axis=1)}
    return replace(domain, name=f"{domain.name}, sensor {half:g}, {best:g}", arrays=arrays, layout=layout)


def evolved(domain: Domain, arm: str, seed: int, steps: int) -> float:
    """Exact return of what an evolution finds within so many steps."""
    p = Parameters(seed=seed, **SHARED, **ARMS[arm])
    grammar, fitness, spent = grammar_for(domain, "rocksample-const"), ProgramFitness(domain, p, "tables", 1), 0
    refine = Refiner(grammar, fitness) if p.refine else None
    for generation in loop.evolve(grammar, p, fitness, loop.first_population(grammar, p), refine=refine):
        spent += generation.cost
        if spent >= steps:
            break
    programs = [fitness.compile(text) for text in islice(generation.ranking(), 20)]
    judged = fitness.judge(programs, p.generations * p.episodes, 2000).means
    winner = programs[int(judged.argmax())]
    found = float(expected(domain, [winner], p.horizon, ROOM).returns[0])
    return found if np.isfinite(found) else float(judged.max())


def row(name: str, returns: dict[str, NDArray[np.float64]]) -> list[str]:
    cells = [name, *(f"{np.median(each):.2f}" for each in returns.values())]
    for arm in ("lines", "autodiff"):
        difference = returns[arm] - returns["plain"]
        error = difference.std(ddof=1) / np.sqrt(len(difference))
        cells += [f"{difference.mean():+.2f} ± {error:.2f}", f"{(difference > 0).sum()} of {len(difference)}"]
    return cells


def main(seeds: int = 10, millions: int = 4) -> None:
    domain, rows = harness.load("rocksample-7x8"), []
    for name, sensor in SENSORS.items():
        harder = with_sensor(domain, *sensor)
        returns = {arm: np.array([evolved(harder, arm, s, millions * 10**6) for s in range(seeds)]) for arm in ARMS}
        rows.append(row(name, returns))
        print(name, {arm: each.round(2).tolist() for arm, each in returns.items()}, file=sys.stderr, flush=True)
    head = ["sensor", *ARMS, "lines − plain", "better", "autodiff − plain", "better"]
    print(f"exact returns after {millions} million steps, {seeds} seeds; medians, and mean paired differences\n")
    print(tabulate(rows, head))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
