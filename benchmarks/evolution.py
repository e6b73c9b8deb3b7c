"""Grammatical evolution: environment steps a second of one generation, and where the time of a run goes.

    make bench                      # or: python -m benchmarks.evolution

250 random programs of 40 statements in 100 episodes each of RockSample(7, 8), next to the same programs in the same
episodes in straightforward Python. One process, one run; every time is the best of several repetitions, first uses
(compilation) left out. Then a run by the paper's parameters, of fewer generations than its 500: what each takes of one.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from typing import Any
from unittest.mock import patch

import numpy as np
from tabulate import tabulate

import harness
from harness import host, registry
from harness.engine import rng
from harness.ge import grammar as bnf
from harness.ge import loop, search
from harness.ge.fitness import ProgramFitness
from harness.ge.hall import Hall
from harness.ge.initialisation import GROW, tree
from harness.ge.mapping import derive
from harness.play.population import Episodes, play
from harness.program import parse, words_of
from tests import reference

PROGRAMS, STATEMENTS, EPISODES, HORIZON = 250, 40, 100, 50
SLOW_PROGRAMS = 5  # as many are enough to time Python
REPETITIONS = 7
GENERATIONS = 200

PARTS: dict[str, tuple[Any, str]] = {
    "playing the generation's episodes": (ProgramFitness, "play"),
    "the best one's fresh score": (search, "_test"),
    "parsing": (ProgramFitness, "compile"),
    "mapping": (loop, "derive"),
    "selection, crossover, mutation": (loop, "next_population"),
    "hall of fame": (Hall, "see"),
    "history": (search, "_row"),
}
"""Of a run: who does each, what the others do for it left out."""


def best_time(run: Callable[[], object]) -> float:
    times = []
    for _ in range(REPETITIONS):
        started = time.perf_counter()
        run()
        times.append(time.perf_counter() - started)
    return min(times)


def random_genotypes(grammar: bnf.Grammar, seed: int) -> list[np.ndarray]:
    """Genotypes of the paper's grammar with 40 statements each: codons that continue the list 39 times, then lines."""
    generator = np.random.default_rng(seed)
    head = np.array([1] * (STATEMENTS - 1) + [0], dtype=np.int32)
    line = grammar.rules.index("<line>")
    return [
        np.concatenate([head, *(tree(grammar, line, 9, GROW, 1000, generator) for _ in range(STATEMENTS))])
        for _ in range(PROGRAMS)
    ]


def plain_python(statements: list[tuple], u: np.ndarray) -> int:
    """Steps of one episode. A statement: (action, None), (action, (rock, "good")) or (action, (rock, threshold))."""
    world, beliefs, last, steps = reference.RockSample(u[0]), [0.5] * 8, {}, 0
    for action, condition in statements:
        if condition is not None:
            rock, wanted = condition
            true = last.get(rock) == wanted if isinstance(wanted, str) else beliefs[rock - 1] > wanted
            if not true:
                continue
        steps += 1
        cell = world.cell
        world.step(action, u[steps])
        if action.startswith("check"):
            rock = int(action[6:-1])
            last[rock] = world.reading
            right = reference.accuracy(cell, reference.ROCKS[rock - 1])
            like = right if world.reading == "good" else 1 - right
            b = beliefs[rock - 1]
            beliefs[rock - 1] = like * b / (like * b + (1 - like) * (1 - b))
        elif action == "sample()" and cell in reference.ROCKS:
            beliefs[reference.ROCKS.index(cell)] = 0.0
        if world.done or steps == HORIZON:
            break
    return steps


def statements_of(text: str) -> list[tuple]:
    statements: list[tuple] = []
    for line in text.splitlines():
        if not line.startswith("if"):
            statements.append((line, None))
            continue
        condition, action = line[3:].split(") ", 1) if "==" in line else line[3:].rsplit(") ", 1)
        if "==" in condition:
            statements.append((action, (int(condition.split()[0]), "good")))
        else:
            statements.append((action, (int(condition[7]), float(condition.split()[-1]))))
    return statements


def clocked(call: Callable[..., Any], part: str, spent: dict[str, float]) -> Callable[..., Any]:
    """The same, its own time added to ``spent``."""

    def timed(*arguments: Any, **named: Any) -> Any:
        others, started = sum(spent.values()), time.perf_counter()
        result = call(*arguments, **named)
        spent[part] += time.perf_counter() - started - (sum(spent.values()) - others)
        return result

    return timed


def parts_of_a_run(workers: int) -> dict[str, float]:
    """Seconds of each part of a run; and of all else."""
    spent = dict.fromkeys(PARTS, 0.0)
    with contextlib.ExitStack() as stack:
        for part, (where, name) in PARTS.items():
            stack.enter_context(patch.object(where, name, clocked(getattr(where, name), part, spent)))
        started = time.perf_counter()
        harness.evolve("rocksample-7x8", generations=GENERATIONS, workers=workers)
        took = time.perf_counter() - started
    return {**spent, "all else, and the final comparison": took - sum(spent.values())}


def main() -> None:
    domain = harness.load("rocksample-7x8")
    grammar = bnf.read(registry.grammar_path("rocksample"))
    words, episodes, cores = words_of(domain), Episodes(0, 0, EPISODES, HORIZON), host.cores()

    def prepare(genotypes: list[np.ndarray]) -> list:
        return [parse(derive(grammar, g).phenotype or "", words) for g in genotypes]

    genotypes = random_genotypes(grammar, 1)
    prepare(genotypes[:1])
    seen = [random_genotypes(grammar, seed) for seed in range(2, 2 + REPETITIONS)]
    fresh = iter(seen)
    first = best_time(lambda: prepare(next(fresh)))  # most statements are met for the first time
    again = best_time(lambda: prepare(genotypes))
    programs = prepare(genotypes)
    steps = int(play(domain, programs, episodes).steps.sum())
    one = best_time(lambda: play(domain, programs, episodes, workers=1))
    all_cores = best_time(lambda: play(domain, programs, episodes, workers=cores))

    u = np.array([rng.uniforms(0, rng.ENGINE, step, 0, EPISODES) for step in range(HORIZON + 1)]).T
    plain = [statements_of(program.text) for program in programs[:SLOW_PROGRAMS]]
    slow_steps = sum(plain_python(p, u[e]) for p in plain for e in range(EPISODES))
    if slow_steps != play(domain, programs[:SLOW_PROGRAMS], episodes).steps.sum():
        raise SystemExit("plain Python and the engine disagree: this would compare different work")
    slow = slow_steps / best_time(lambda: [plain_python(p, u[e]) for p in plain for e in range(EPISODES)])
    table = [
        [
            f"evaluation, {cores} threads",
            f"{1e3 * all_cores:.1f}",
            f"{steps / all_cores / 1e6:.1f} M",
            steps / all_cores / slow,
        ],
        ["evaluation, one thread", f"{1e3 * one:.1f}", f"{steps / one / 1e6:.1f} M", steps / one / slow],
        ["straightforward Python", f"{1e3 * steps / slow:.0f}", f"{slow / 1e6:.3f} M", 1.0],
        ["mapping, parsing, compiling", f"{1e3 * again:.1f}", "", None],
        ["the same, statements never met before", f"{1e3 * first:.1f}", "", None],
    ]
    print(f"{PROGRAMS} random programs of {STATEMENTS} statements x {EPISODES} episodes, {steps:,} steps\n")
    print(tabulate(table, headers=["", "ms", "steps/s", "x Python"], floatfmt=".0f"))

    harness.evolve("rocksample-7x8", generations=1)
    spent = parts_of_a_run(cores)
    whole = sum(spent.values())
    rows = [[part, 1e3 * seconds / GENERATIONS, seconds / whole] for part, seconds in [*spent.items(), ("all", whole)]]
    print(f"\na run of {GENERATIONS} generations by the paper's parameters, {whole:.1f} s on {cores} threads\n")
    print(tabulate(rows, headers=["", "ms a generation", "share"], floatfmt=("", ".2f", ".0%")))


if __name__ == "__main__":
    main()
