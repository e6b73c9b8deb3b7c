"""Evolutionary runs on a domain, from the first population to the winner's score on fresh episodes."""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from harness import engine as engines
from harness import files, host, registry
from harness.engine import rng
from harness.errors import HarnessError
from harness.ge import grammar as bnf
from harness.ge import loop, parameter_file
from harness.ge.defaults import grammar_for
from harness.ge.edits import Editor
from harness.ge.fitness import ProgramFitness, check_language
from harness.ge.folder import RunFolder, State, provenance
from harness.ge.front import front
from harness.ge.grammar import Grammar
from harness.ge.hall import Hall
from harness.ge.improvements import Improvements
from harness.ge.local_search import LocalSearch
from harness.ge.parameters import EDITS, LAMARCKIAN, Parameters, from_record
from harness.ge.results import Best, Evolution
from harness.model.domain import Domain
from harness.play import population
from harness.play.evaluation import evaluate, mean_and_sem
from harness.policy.team import policy_of
from harness.program import words_of

_CHECKPOINT_SECONDS = 1.0

Watcher = Callable[[Mapping[str, Any]], object]
"""Called with every row of the history as it is made."""


class Setup(NamedTuple):
    """All that decides the results of a run, and the workers, which do not."""

    domain: Domain
    grammar: Grammar
    parameters: Parameters
    engine: str
    workers: int


def prepare(
    domain: Domain | str, grammar: str | Path | None, engine: str, workers: int, parameters: Mapping[str, Any]
) -> Setup:
    """Check everything before anything runs.

    Raises:
        HarnessError: domain, grammar, engine or a parameter is wrong.
    """
    domain = registry.load(domain) if isinstance(domain, str) else domain
    return _checked(domain, grammar_for(domain, grammar), from_record(dict(parameters)), engine, workers)


def _checked(domain: Domain, grammar: Grammar, parameters: Parameters, engine: str, workers: int) -> Setup:
    domain.shaped(parameters.shaping)
    _check_memory(domain, parameters)
    check_language(grammar, words_of(domain))
    _check_codons(grammar, parameters.codon_size)
    if parameters.refine:
        from harness.ge.refinement import check_constants  # here: it brings in all of the tuning

        words, in_between = words_of(domain), parameters.refine_every > 0
        check_constants(grammar, words, in_between and parameters.inheritance == LAMARCKIAN)
    return Setup(domain, grammar, parameters, engines.choose(engine, domain), workers)


def _check_codons(grammar: Grammar, codon_size: int) -> None:
    """Codons reach every alternative."""
    for rule, productions in zip(grammar.rules, grammar.productions_of, strict=True):
        if len(productions) > codon_size:
            raise HarnessError(
                f"codon_size must be {len(productions)} or more, not {codon_size}: {rule} of {grammar.source} has as "
                "many alternatives, and codons below codon_size choose among them"
            )


def _check_memory(domain: Domain, p: Parameters) -> None:
    """Check what the largest parts of a run take, before any has begun."""
    finalists = min(p.finalists, p.population) + p.refine
    for programs, episodes in (
        (p.population, p.episodes),
        (finalists, p.validation_episodes),
        (1, max(p.test_episodes, p.score_episodes, p.refine_episodes if p.refine else 0)),
    ):
        host.check_memory(*population.memory(domain, programs, episodes, p.horizon))
    codons = p.population * p.max_codons
    host.check_memory(f"a population of {p.population:,} with {p.max_codons:,} codons each", codons * _CODON)
    if p.uses_cases:
        numbers = p.population * p.episodes
        host.check_memory(f"the fitness of {p.population:,} in {p.episodes:,} cases each", numbers * _CASE)


_CASE = 48  # bytes, with the copies of it that breeding takes
_CODON = 16  # bytes, with its part of the derivation


def config_of(setup: Setup, name: str) -> dict[str, Any]:
    """The ``config.json`` of a run; ``name`` is how the domain is loaded again."""
    return {
        "domain": name,
        "domain_version": setup.domain.version,
        "model_hash": setup.domain.model_hash,
        "grammar": Path(setup.grammar.source).name,
        "engine": setup.engine,
        "parameters": setup.parameters.__dict__,
        **provenance(),
    }


def restore(folder: RunFolder, workers: int, generations: int | None = None, allow_code: bool = False) -> Setup:
    """The setup of a run that has a folder; with ``generations``, to go on for longer than it was meant to.

    Raises:
        HarnessError: the folder is damaged, its domain is no longer the same, or is a file and ``allow_code`` is False.
    """
    config = folder.config()
    domain = registry.load_from_data(config["domain"], allow_code)
    if domain.model_hash != config["model_hash"]:
        raise HarnessError(
            f"{folder.path} was begun on version {config.get('domain_version')} of {config['domain']}, another model "
            f"than today's version {domain.version}; start a new run"
        )
    more = {} if generations is None else {"generations": generations}
    parameters = from_record({**config["parameters"], **more})
    grammar = bnf.parse(folder.grammar(), config["grammar"])
    return _checked(domain, grammar, parameters, config["engine"], workers)


def run(setup: Setup, folder: RunFolder | None, watch: Watcher) -> Evolution:
    """Evolve to the end. Ctrl-C leaves the folder with a checkpoint of the last whole generation."""
    p = setup.parameters
    fitness = ProgramFitness(setup.domain, p, setup.engine, setup.workers)
    state = folder.state() if folder else None
    if folder and state and len(state.population) != p.population:
        raise HarnessError(f"the checkpoint in {folder.path} is of another run; start anew in another folder")
    rows = list(state.rows) if state else []
    start, first = (state.generation, state.population) if state else (0, loop.first_population(setup.grammar, p))
    past = state.past if state else None
    for row in rows:
        watch(row)
    saved = begun = time.monotonic()
    last: loop.Generation | None = None  # the last one that is in the history
    test = functools.lru_cache(maxsize=1)(functools.partial(_test, setup, fitness))  # the best often stays the best
    rivals: list[str] = []
    if folder:
        files.replace_text(folder.path / parameter_file.NAME, parameter_file.text(p, setup.domain.name))
    hall = fitness.hall = Hall(folder.path if folder else None, len(rows))
    improvements = Improvements(folder.path if folder else None, rows)
    if folder:
        folder.entries = [improvements, hall]
    try:
        for generation in loop.evolve(setup.grammar, p, fitness, first, start, past, *_variation(setup, fitness)):
            if generation.number == p.generations:
                generation, rivals = _with_rivals(p, fitness, generation)
            if generation.number == len(rows):  # a checkpoint's own generation has its row
                now = time.monotonic()
                rows.append(_row(test, generation, now - begun))
                if (best := generation.best()) is not None:
                    improvements.see(rows[-1], fitness.compile(best))
                last, begun = generation, now
                watch(rows[-1])
            last = generation
            if folder and time.monotonic() - saved > _CHECKPOINT_SECONDS:
                _save(folder, fitness, last, rows)
                saved = time.monotonic()
    finally:
        if folder and last:
            _save(folder, fitness, last, rows[: last.number + 1])
    assert last is not None
    return _finish(setup, fitness, last, (rivals, hall.programs()), pd.DataFrame(rows), folder)


def _variation(setup: Setup, fitness: ProgramFitness) -> tuple[list[loop.Lesson], loop.Mutate | None]:
    """What the best learn, and the mutation where it is by edits."""
    p, lessons = setup.parameters, []
    editor = Editor(setup.grammar, fitness.domain, p) if p.local_search or p.mutation == EDITS else None
    if editor and p.local_search:
        lessons.append(loop.Lesson(LocalSearch(editor, fitness.alone, p), p.local_search, p.local_search_every))
    if p.refine_every:
        from harness.ge.refinement import Refiner  # here: it brings in all of the tuning

        lessons.append(loop.Lesson(Refiner(setup.grammar, fitness), p.refine, p.refine_every))
    return lessons, editor.mutate if editor and p.mutation == EDITS else None


def _with_rivals(p: Parameters, fitness: ProgramFitness, last: loop.Generation) -> tuple[loop.Generation, list[str]]:
    """The last generation, its cost that of tuning its best programs too, and what they became."""
    if not p.refine:
        return last, []
    from harness.ge.refinement import rivals

    made, cost = rivals(fitness, list(_different(fitness, last))[: p.refine], p.generations + 1)
    return last._replace(cost=last.cost + cost), made


def _different(fitness: ProgramFitness, last: loop.Generation) -> dict[str, float]:
    """The different programs of a generation as written out, and their fitness, best first."""
    by_text: dict[str, float] = {}
    for text, value in last.ranking().items():
        by_text.setdefault(fitness.compile(text).text, value)
    return by_text


def _save(folder: RunFolder, fitness: ProgramFitness, generation: loop.Generation, rows: list[dict[str, Any]]) -> None:
    best = generation.best()
    state = State(generation.number, list(generation.population), rows, generation.past)
    folder.save(state, None if best is None else fitness.compile(best).text)


def _row(
    tested: Callable[[str], tuple[float, float, int]], generation: loop.Generation, seconds: float
) -> dict[str, Any]:
    """A row of the history, columns of :data:`harness.ge.results.COLUMNS`."""
    scores, derivations = generation.fitness, [individual.derivation for individual in generation.individuals]
    valid = np.isfinite(scores)
    texts = [d.phenotype for d, finite in zip(derivations, valid, strict=True) if d.phenotype is not None and finite]
    best = generation.best()
    test, sem, length = tested(best) if best is not None else (np.nan, np.nan, 0)
    return {
        "generation": generation.number,
        "best": float(scores.max()),
        "mean": float(scores[valid].mean()) if texts else np.nan,
        "median": float(np.median(scores[valid])) if texts else np.nan,
        "invalid": float(1 - valid.mean()),
        "unique": len(set(texts)) / len(scores),
        "behaviours": generation.behaviours,
        "test": test,
        "test_sem": sem,
        "best_length": length,
        "length": float(np.mean([len(text) for text in texts])) if texts else np.nan,
        "codons": float(np.mean([len(individual.codons) for individual in generation.individuals])),
        "used": float(np.mean([d.used for d in derivations])),
        "depth": float(np.mean([d.depth for d in derivations])),
        "steps": generation.cost,
        "seconds": round(seconds, 4),
    }


def _test(setup: Setup, fitness: ProgramFitness, best: str) -> tuple[float, float, int]:
    """True mean return of a program on fresh episodes, its standard error, and the program's length."""
    p, program = setup.parameters, fitness.compile(best)
    episodes = population.Episodes(rng.HELD_OUT + p.seed, 0, p.test_episodes, p.horizon)
    domain = setup.domain.shaped("none")
    returns = population.play(domain, [program], episodes, setup.engine, discount=fitness.discount).returns[0]
    return *mean_and_sem(returns), program.length


def _finish(
    setup: Setup,
    fitness: ProgramFitness,
    last: loop.Generation,
    kept: tuple[list[str], list[str]],
    history: pd.DataFrame,
    folder: RunFolder | None,
) -> Evolution:
    """Compare the best programs of the last generation, and their rivals with tuned constants, on new episodes; score
    the winner on fresh ones. Those of the hall of fame are compared with them for the front alone: ``kept`` are rivals
    and hall."""
    p = setup.parameters
    by_text = _different(fitness, last)
    if not by_text:
        raise HarnessError("no individual of the last generation is valid; allow wraps, or more codons")
    rivals, hall = kept
    texts = list(dict.fromkeys([*list(by_text)[: p.finalists], *rivals]))
    finalists = _compared(fitness, texts, by_text)
    compared = pd.concat([finalists, _compared(fitness, [text for text in hall if text not in texts], by_text)])
    winner = fitness.compile(str(finalists["program"][0]))
    result = evaluate(
        setup.domain.shaped("none"),
        policy_of(winner),
        episodes=p.score_episodes,
        seed=rng.HELD_OUT + p.seed,
        horizon=p.horizon,
        engine=setup.engine,
        workers=setup.workers,
    )
    best = Best(winner, by_text.get(winner.text, math.nan), float(finalists["validation"][0]), result.score)
    found = Evolution(setup.domain.name, p, history, finalists, front(_unpenalized(compared, p)), best)
    if folder:
        folder.finish(_record(setup, best), finalists, found.front)
    return found


def _unpenalized(compared: pd.DataFrame, p: Parameters) -> pd.DataFrame:
    """The comparison without the penalty for length: a front of return against length shows that by itself."""
    excess = (compared["length"] - p.free_length).clip(lower=0)
    return compared.assign(validation=compared["validation"] + p.penalty * excess)


def _compared(fitness: ProgramFitness, texts: Sequence[str], by_text: Mapping[str, float]) -> pd.DataFrame:
    """Programs judged on episodes that no generation has seen, the best first."""
    p, programs = fitness.parameters, [fitness.compile(text) for text in texts]
    judged = fitness.judge(programs, (p.generations + 1) * p.episodes, p.validation_episodes)
    rows = {
        "fitness": [by_text.get(text, np.nan) for text in texts],
        "validation": fitness.penalized(programs, judged.means),
        "validation_sem": judged.sems,
        "length": [program.length for program in programs],
        "program": list(texts),
    }
    return pd.DataFrame(rows).sort_values("validation", ascending=False, kind="stable", ignore_index=True)


def _record(setup: Setup, best: Best) -> dict[str, Any]:
    """``best.json``: the winner with its figures and all that it came from."""
    return {
        "program": best.text.splitlines(),
        "fitness": None if math.isnan(best.fitness) else best.fitness,
        "validation": best.validation,
        "score": best.score._asdict(),
        **config_of(setup, setup.domain.name),
        "grammar_text": setup.grammar.text.splitlines(),
    }
