"""What a run found: the best, beside where it started and where its method ended."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import pandas as pd

from harness import cards
from harness.engine import rng
from harness.play.evaluation import Evaluation, Score, mean_and_sem
from harness.tuning import choosing
from harness.tuning.objective import Episodes
from harness.tuning.tunable import Vector

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Scored:
    """A point of a run."""

    theta: dict[str, float]
    """By name; but for the start rounded to :data:`harness.tuning.constants.DECIMALS`: what is printed is what was
    scored."""
    policy: str
    """What names the policy: a policy string where there is one."""
    score: Score
    """On fresh episodes, of a seed that no tuning uses."""
    training: Score
    """On the episodes of the last iteration, which the tuning has seen."""


class Gain(NamedTuple):
    """What the best earns more than the start, on the same fresh episodes: the mean of the differences, its error."""

    mean: float
    sem: float
    discounted_mean: float
    discounted_sem: float


@dataclass(frozen=True)
class Tuned:
    """A finished run."""

    method: str
    config: Mapping[str, Any]
    history: pd.DataFrame
    """A row for every point that was played: its iteration, its numbers, ``value`` and ``sem``; and of its iteration
    the iterate ``theta_…``, ``gradient_…``, ``velocity_…``, ``rate`` and ``step``."""
    best: Scored
    """The best of the start and the points visited, on validation episodes that none of them has met
    (:mod:`harness.tuning.choosing`)."""
    start: Scored
    ended: Scored
    """Where the method stood at its end, be that the best or not."""
    gain: Gain
    stopped: str
    """Why it stopped, as a sentence."""

    @property
    def moved(self) -> bool:
        """Whether anything visited was better than the start."""
        return self.best.theta != self.start.theta

    def plot(self) -> Figure:
        """Values and iterates over the iterations, as a matplotlib figure."""
        from harness.tuning.figures import history_figure

        return history_figure(self.history, list(self.best.theta), self.config["run"]["measure"])

    def _facts(self) -> dict[str, object]:
        score = self.best.score
        return {
            "return": cards.plus_minus(score.mean, score.sem),
            "discounted": cards.plus_minus(score.discounted_mean, score.discounted_sem),
            "points played": len(self.history),
            "stopped": self.stopped,
        }

    def __repr__(self) -> str:
        """What came out and why it stopped, on one line."""
        return cards.line("Tuned", f"{brief(self.best.policy)} by {self.method}", self._facts())

    def _repr_html_(self) -> str:
        policy = self.best.policy
        text = policy if "\n" in policy else ""
        return cards.card("Tuned", f"{brief(policy)} by {self.method}", self._facts(), text)


def brief(policy: str) -> str:
    """What names a policy, on one line: a program by its first statement."""
    first, _, rest = policy.partition("\n")
    return f"the program '{first} …'" if rest or "\n" in policy else policy


def outcome(
    played: Episodes, run: Mapping[str, Any], history: pd.DataFrame, ended: Vector, last: tuple[int, int]
) -> tuple[Scored, Scored, Scored, Gain]:
    """Best, start and end of a run, and what the best earns more than the start."""
    true = replace(played, domain=played.domain.shaped("none"))
    points = choosing.candidates(played.subject, history, ended)
    chosen = points[choosing.choose(replace(true, range=rng.VALIDATION), points, run["validation_episodes"])]
    places = [chosen, points[0], choosing.rounded(played.subject, ended)]
    fresh = [true.play(theta, run["final_episodes"], rng.HELD_OUT + played.seed) for theta in places]
    scored = [_scored(played, theta, each, last) for theta, each in zip(places, fresh, strict=True)]
    return scored[0], scored[1], scored[2], _gain(fresh[0], fresh[1])


def _scored(played: Episodes, theta: Vector, fresh: Evaluation, last: tuple[int, int]) -> Scored:
    first, count = last
    training = played.play(theta, count, rng.TRAINING + played.seed, first).score
    named = {name: float(x) for name, x in zip(played.subject.names, theta, strict=True)}
    return Scored(named, played.subject.text(theta), fresh.score, training)


def _gain(best: Evaluation, start: Evaluation) -> Gain:
    discounted = mean_and_sem(best.discounted - start.discounted)
    return Gain(*mean_and_sem(best.returns - start.returns), *discounted)


def record(result: Tuned) -> dict[str, Any]:
    """``result.json``."""
    return {
        "stopped": result.stopped,
        **_place(result.best),
        "start": _place(result.start),
        "ended": _place(result.ended),
        "gain": result.gain._asdict(),
    }


def _place(scored: Scored) -> dict[str, Any]:
    scores = {"training": scored.training._asdict(), "fresh": scored.score._asdict()}
    return {"policy": scored.policy, "theta": scored.theta, **scores}
