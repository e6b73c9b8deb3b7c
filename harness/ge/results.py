"""What evolution found: histories, the best program, and how well many runs did."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from harness import cards
from harness.errors import HarnessError, quoted
from harness.ge.parameters import Parameters
from harness.play.evaluation import Score
from harness.policy import Policy
from harness.policy.team import policy_of
from harness.program import Program, parse

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

QUARTILES = (0.25, 0.5, 0.75)


@dataclass(frozen=True)
class Best:
    """The winner of a run."""

    program: Program
    fitness: float
    """Of the last generation: the episodes that selected it, so it is a lucky figure. NaN for a program whose constants
    were tuned at the end, which no generation has seen."""
    validation: float
    """Fitness in the comparison of the finalists, of which it is the maximum, so still a little lucky."""
    score: Score
    """On fresh episodes, of the true reward without shaping or penalty: the honest figure."""

    @property
    def text(self) -> str:
        """The program, one statement a line."""
        return self.program.text

    @property
    def policy(self) -> Policy:
        """The program as a policy, for ``evaluate``, ``compare`` and ``replay``."""
        return policy_of(self.program)


@dataclass(frozen=True)
class Evolution:
    """The result of one run."""

    domain: str
    parameters: Parameters
    history: pd.DataFrame
    """One row a generation, columns :data:`COLUMNS`."""
    finalists: pd.DataFrame
    """The programs compared at the end: fitness, validation and its standard error, length, program."""
    front: pd.DataFrame
    """Of these and of the hall of fame, those that earn more than all shorter ones (:mod:`harness.ge.front`)."""
    best: Best

    def pick(self, index: int) -> Policy:
        """The program of a row of :attr:`front` as a policy.

        Raises:
            HarnessError: there is no such row.
        """
        if not 0 <= index < len(self.front):
            raise HarnessError(f"the front has programs 0 to {len(self.front) - 1}, and no {quoted(index)}")
        words, text = self.best.program.words, str(self.front["program"][index])
        return policy_of(parse(text, words, loop=self.parameters.loop))

    def plot(self, axes: Axes | None = None) -> Figure:
        """Learning curve: what selection saw of the best, and its score on fresh episodes with the 95 % interval.

        ``axes``: where to draw; by default on a new figure. The figure drawn on is returned.
        """
        from harness.ge.figures import run_figure

        return run_figure(self.history, axes)

    def _facts(self) -> dict[str, object]:
        score = self.best.score
        return {
            "seed": self.parameters.seed,
            "generations": len(self.history) - 1,
            "return": cards.plus_minus(score.mean, score.sem),
            "discounted": cards.plus_minus(score.discounted_mean, score.discounted_sem),
            "statements": self.best.program.length,
        }

    def __repr__(self) -> str:
        """The best program's score and length, on one line."""
        return cards.line("Evolution", f"on {self.domain}", self._facts())

    def _repr_html_(self) -> str:
        return cards.card("Evolution", f"on {self.domain}", self._facts(), self.best.text)


@dataclass(frozen=True)
class Evolutions:
    """The results of independent runs that differ in their seeds."""

    runs: list[Evolution]

    @property
    def history(self) -> pd.DataFrame:
        """All histories one below the other, with a column ``seed``."""
        return pd.concat([run.history.assign(seed=run.parameters.seed) for run in self.runs], ignore_index=True)

    @property
    def best(self) -> Best:
        """Of the run whose winner did best in its comparison of finalists; its ``score`` was not looked at for that."""
        return max(self.runs, key=lambda run: run.best.validation).best

    @property
    def table(self) -> pd.DataFrame:
        """One row a run: seed, figures of the winner, its length and text."""
        rows = [
            {
                "seed": run.parameters.seed,
                "fitness": run.best.fitness,
                "validation": run.best.validation,
                "mean": run.best.score.mean,
                "sem": run.best.score.sem,
                "discounted_mean": run.best.score.discounted_mean,
                "discounted_sem": run.best.score.discounted_sem,
                "success_rate": run.best.score.success_rate,
                "length": run.best.program.length,
                "steps": int(run.history["steps"].sum()),
                "program": run.best.text,
            }
            for run in self.runs
        ]
        return pd.DataFrame(rows)

    def curve(self, column: str = "test") -> pd.DataFrame:
        """Quartiles over the runs of a column of the history, one row a generation: q25, q50, q75."""
        return quartiles(self.history, column)

    def plot(self, axes: Axes | None = None) -> Figure:
        """Median and quartiles over the runs of the best's score on fresh episodes; of one run, its own curve.

        ``axes``: where to draw; by default on a new figure. The figure drawn on is returned.
        """
        from harness.ge.figures import run_figure, runs_figure

        return runs_figure(self.history, axes) if len(self.runs) > 1 else run_figure(self.history, axes)

    def _facts(self) -> dict[str, object]:
        low, middle, high = np.quantile([run.best.score.mean for run in self.runs], QUARTILES)
        score = self.best.score
        return {
            "runs": len(self.runs),
            "median return": f"{middle:.2f} (quartiles {low:.2f} to {high:.2f})",
            "return of the best": cards.plus_minus(score.mean, score.sem),
        }

    def __repr__(self) -> str:
        """How well the runs did, on one line."""
        return cards.line("Evolutions", f"on {self.runs[0].domain}", self._facts())

    def _repr_html_(self) -> str:
        return cards.card("Evolutions", f"on {self.runs[0].domain}", self._facts(), self.best.text)


def quartiles(history: pd.DataFrame, column: str) -> pd.DataFrame:
    """Quartiles of a column over the runs in ``history``, one row a generation: q25, q50, q75."""
    groups = history.groupby("generation")[column]
    return pd.DataFrame({f"q{round(100 * q)}": groups.quantile(q) for q in QUARTILES})


COLUMNS = {
    "generation": "0 is the first population",
    "best": "fitness of the best: the maximum of noisy figures, so a lucky one",
    "mean": "mean fitness of the valid individuals",
    "median": "their median fitness",
    "invalid": "share of individuals whose derivation did not end",
    "unique": "share of different phenotypes",
    "behaviours": "number of programs whose returns differ, in some episode or in expectation",
    "test": "mean true return of the best on fresh episodes, the same in every generation",
    "test_sem": "its standard error",
    "best_length": "statements of the best",
    "length": "mean length of the phenotypes, in characters",
    "codons": "mean length of the genotypes",
    "used": "mean number of codons read",
    "depth": "mean depth of the derivation trees",
    "steps": "environment steps (exact: situations) of the fitness evaluations and of tuning constants",
    "seconds": "time the generation took, the only column that differs between equal runs",
}
"""Columns of a history."""
