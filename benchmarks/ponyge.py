"""Generations a second of PonyGE2 and of ours, on the paper's grammar of RockSample(7, 8).

    git clone https://github.com/PonyGE/PonyGE2
    python -m benchmarks.ponyge PonyGE2

250 individuals in 100 episodes, one-point crossover, per-codon mutation, tournaments of two, in one process and one
thread. PonyGE2 runs twice: with a fitness that calls our evaluator, one individual a call as it asks for them, and with
straightforward Python. Another search walks other programs, which cost more or less; so the mean number of environment
steps that a program took stands beside each. The first generation, which compiles, is left out.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import sys
import time
import types
from pathlib import Path
from typing import Any

import numpy as np
from tabulate import tabulate

import harness
from benchmarks.evolution import plain_python, statements_of
from harness import registry
from harness.engine import rng
from harness.play import population
from harness.play.population import Episodes
from harness.program import parse, words_of

DOMAIN, POPULATION, EPISODES, HORIZON = "rocksample-7x8", 250, 100, 50


class Clock:
    """When PonyGE2's generations ended, and what its programs took."""

    def __init__(self) -> None:
        self.ends: list[float] = []
        self.steps = self.programs = 0

    def rates(self) -> tuple[float, float]:
        """Generations a second, and steps a program."""
        return (len(self.ends) - 1) / (self.ends[-1] - self.ends[0]), self.steps / self.programs


def ours(generations: int) -> tuple[float, float]:
    history = harness.evolve(
        DOMAIN, population=POPULATION, generations=generations, episodes=EPISODES, workers=1, finalists=1,
        validation_episodes=2, score_episodes=2, test_episodes=2,
    ).history[1:]  # fmt: skip
    return generations / history["seconds"].sum(), (history["steps"] / (history["unique"] * POPULATION)).mean()


def of_evaluator(clock: Clock) -> Any:
    domain = harness.load(DOMAIN)
    words, episodes = words_of(domain), Episodes(rng.TRAINING, 0, EPISODES, HORIZON)

    def fitness(text: str) -> float:
        played = population.play(domain, [parse(text, words)], episodes)
        clock.steps += int(played.steps[0])
        return float(played.returns.mean())

    return fitness


def of_python(clock: Clock) -> Any:
    """Plays in Python. What the search needs to know of the returns is our evaluator's, in a hundredth of the time."""
    words, known = words_of(harness.load(DOMAIN)), of_evaluator(Clock())
    u = np.array([rng.uniforms(rng.TRAINING, rng.ENGINE, step, 0, EPISODES) for step in range(HORIZON + 1)]).T

    def fitness(text: str) -> float:
        statements = statements_of(parse(text, words).text)
        clock.steps += sum(plain_python(statements, u[e]) for e in range(EPISODES))
        return known(text)

    return fitness


def ponyge(folder: Path, generations: int, make: Any) -> tuple[float, float]:
    """A run of PonyGE2 in this process, with its own set-up for these operators."""
    clock = Clock()
    vars(np)["NaN"] = np.nan  # a name that NumPy has dropped and PonyGE2 uses
    source = str((folder / "src").resolve())
    for name, module in list(sys.modules.items()):
        if (getattr(module, "__file__", None) or "").startswith(source):
            del sys.modules[name]  # its parameters are global
    sys.path.insert(0, source)
    os.chdir(source)
    from algorithm.parameters import params, set_params
    from fitness.base_ff_classes.base_ff import base_ff

    fitness = make(clock)

    class Pomdp(base_ff):
        maximise = True

        def evaluate(self, ind: Any, **_: Any) -> float:
            clock.programs += 1
            return fitness(ind.phenotype)

    sys.modules["fitness.Pomdp"] = types.ModuleType("fitness.Pomdp")
    sys.modules["fitness.Pomdp"].Pomdp = Pomdp
    grammar = Path(source) / "pomdp.bnf"
    text = registry.grammar_path("rocksample").read_text(encoding="utf-8")
    grammar.write_text("".join(line for line in text.splitlines(True) if not line.startswith("#")), encoding="utf-8")
    given = {
        "--grammar_file": grammar, "--fitness_function": "Pomdp", "--population_size": POPULATION,
        "--generations": generations, "--crossover": "variable_onepoint", "--mutation": "int_flip_per_codon",
        "--selection": "tournament", "--tournament_size": 2, "--max_genome_length": 2000, "--max_tree_depth": 90,
        "--max_init_tree_depth": 20, "--random_seed": 1, "--crossover_probability": 0.75,
    }  # fmt: skip
    set_params([*(str(word) for pair in given.items() for word in pair), "--silent", "--dont_lookup_fitness"])
    step = params["STEP"]

    def timed(individuals: Any) -> Any:
        clock.ends.append(time.perf_counter())
        return step(individuals)

    params["STEP"] = timed
    params["SEARCH_LOOP"]()
    clock.ends.append(time.perf_counter())
    return clock.rates()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("ponyge", type=Path, help="folder of PonyGE2's repository")
    given = parser.parse_args()
    folder, rows = given.ponyge.resolve(), []
    for name, run in (
        ("PonyGE2, straightforward Python", lambda: ponyge(folder, 3, of_python)),
        ("PonyGE2, our evaluator", lambda: ponyge(folder, 20, of_evaluator)),
        ("ours", lambda: ours(100)),
    ):
        with contextlib.redirect_stdout(io.StringIO()):  # PonyGE2 prints its populations
            rate, steps = run()
        rows.append([name, f"{rate:.2f}", f"{steps:,.0f}"])
        print(*rows[-1], flush=True)
    print(tabulate(rows, headers=["", "generations a second", "steps a program"], disable_numparse=True))


if __name__ == "__main__":
    main()
