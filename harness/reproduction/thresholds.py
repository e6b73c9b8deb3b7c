"""Grammatical evolution of a parametrized policy: the phenotype is one constant, the threshold (paper, section 5)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import pandas as pd

from harness.engine import rng
from harness.ge import grammar as bnf
from harness.ge import loop
from harness.ge.grammar import Grammar
from harness.ge.loop import Evaluated
from harness.ge.parameters import Parameters
from harness.play.evaluation import HORIZON, Score, evaluate
from harness.reproduction import paper
from harness.reproduction.folder import Folder


def grammar(word: str) -> Grammar:
    """Its sentences are policy strings, from ``word:0.50`` to ``word:0.99``."""
    return bnf.parse(
        f"<policy> ::= '{word}:0.'<high><digit>\n<high> ::= 5 | 6 | 7 | 8 | 9\n"
        "<digit> ::= 0 | 1 | 2 | 3 | 4 | 5 | 6 | 7 | 8 | 9\n"
    )


def evolve(folder: Folder, word: str, seed: int) -> pd.DataFrame:
    """One run with Table 2's parameters; a row a generation: its best policy, the fitness, the return on fresh ones."""
    s = folder.sizes
    p = Parameters(
        population=s.population, episodes=s.training_episodes, generations=s.threshold_generations, seed=seed
    )

    def played(spec: str, episodes: int, which: int, first: int = 0) -> Score:
        result = evaluate(
            paper.ROCKSAMPLE, spec, episodes=episodes, seed=which + seed, first=first, horizon=HORIZON,
            engine=folder.engine, workers=1,
        )  # fmt: skip
        return result.score

    def fitness(phenotypes: Sequence[str], generation: int) -> Evaluated:
        scores = [played(spec, p.episodes, rng.TRAINING, generation * p.episodes) for spec in phenotypes]
        means = np.array([score.mean for score in scores])
        return Evaluated(means, len(np.unique(means)), round(sum(score.steps_mean * p.episodes for score in scores)))

    fresh = lru_cache(maxsize=None)(lambda spec: played(spec, s.test_episodes, rng.HELD_OUT).mean)
    rows = []
    searched = grammar(word)
    for generation in loop.evolve(searched, p, fitness, loop.first_population(searched, p)):
        best = generation.best()
        assert best is not None
        rows.append(
            {
                "generation": generation.number,
                "best": float(generation.fitness.max()),
                "policy": best,
                "test": fresh(best),
                "steps": generation.cost,
            }
        )
    return pd.DataFrame(rows)


def winners(folder: Folder, curves: pd.DataFrame) -> pd.DataFrame:
    """The policy that each run ended with: heuristic, seed, threshold, and its score on fresh episodes."""
    rows = []
    last = curves[curves["generation"] == folder.sizes.threshold_generations]
    for _, row in last.iterrows():
        result = evaluate(
            paper.ROCKSAMPLE, row["policy"], episodes=folder.sizes.episodes, seed=rng.HELD_OUT, engine=folder.engine,
            workers=folder.workers,
        )  # fmt: skip
        threshold = float(row["policy"].partition(":")[2])
        score = result.score
        rows.append([row["heuristic"], row["seed"], threshold, score.mean, score.sem])
    return pd.DataFrame(rows, columns=["heuristic", "seed", "threshold", "mean", "sem"])
