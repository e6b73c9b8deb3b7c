"""A tuning run: a method asks, episodes answer, a journal remembers; the result is scored on fresh episodes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from harness import engine as engines
from harness import files, host, registry
from harness import policy as policies
from harness.engine import rng
from harness.errors import HarnessError, nearest, quoted
from harness.model.domain import Domain
from harness.play.evaluation import EPISODES, HORIZON, Score, mean_and_sem
from harness.progress import Bar, Progress
from harness.tuning import journal, objective
from harness.tuning.ascent import ForwardDifference
from harness.tuning.cmaes import CmaEs
from harness.tuning.constants import DECIMALS, Constants
from harness.tuning.lines import Lines
from harness.tuning.method import Method, configure, settings_of
from harness.tuning.objective import Episodes, Objective
from harness.tuning.score import ScoreFunction
from harness.tuning.spsa import Spsa
from harness.tuning.tunable import Tunable, Vector, tunable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

METHODS: dict[str, type[Any]] = {
    "gradient": ForwardDifference,
    "spsa": Spsa,
    "score": ScoreFunction,
    "cmaes": CmaEs,
    "lines": Lines,
}
"""Ways uphill by name; their fields are their settings."""


@dataclass(frozen=True)
class Best:
    """Where a run ended."""

    theta: dict[str, float]
    """By name, rounded to :data:`harness.tuning.constants.DECIMALS`: what is printed is what was scored."""
    policy: str
    """What names the policy: a policy string where there is one."""
    score: Score
    """On fresh episodes, of a seed that no tuning uses."""
    training: Score
    """On the episodes of the last iteration, which the tuning has seen."""


@dataclass(frozen=True)
class Tuned:
    """A finished run."""

    method: str
    config: Mapping[str, Any]
    history: pd.DataFrame
    """A row for every point that was played: its iteration, its numbers, ``value`` and ``sem``; and of its iteration
    the iterate ``theta_…``, ``gradient_…``, ``velocity_…``, ``rate`` and ``step``."""
    best: Best
    stopped: str
    """Why it stopped, as a sentence."""

    def plot(self) -> Figure:
        """Values and iterates over the iterations, as a matplotlib figure."""
        from harness.tuning.figures import history_figure

        return history_figure(self.history, list(self.best.theta), self.config["run"]["measure"])


def tune(
    domain: Domain | str,
    policy: str | Tunable,
    *,
    method: str = "gradient",
    measure: str = "return",
    seed: int = 0,
    horizon: int = HORIZON,
    final_episodes: int = EPISODES,
    engine: str = "auto",
    workers: int | None = None,
    out: str | Path | None = None,
    resume: bool = False,
    progress: Progress = False,
    **settings: float,
) -> Tuned:
    """Tune the numbers in a policy.

    Args:
        domain: a domain or its name. Its shaping counts while tuning, never in the final score.
        policy: a policy string, whose numbers are the start (``belief:0.6``, ``program:FILE``), a program's text, or an
            object of the Tunable protocol.
        method: ``gradient`` (the paper's), ``spsa``, ``score``, ``cmaes`` or ``lines``.
        measure: what to maximise, the undiscounted ``return`` within the horizon or the ``discounted`` one.
        seed: of the run. Its episodes lie far from those that people score with.
        horizon: steps after which an episode is truncated.
        final_episodes: fresh ones for the final score.
        engine: ``tables``, ``julia`` or ``auto``; the numbers do not depend on it.
        workers: threads of the tables engine; the numbers do not depend on it.
        out: a folder for ``config.json``, ``history.csv`` and ``result.json``; of a program also ``best.txt``.
        resume: go on with the run in ``out``, which must have been started with these same arguments.
        progress: True for a bar on a terminal, or a function that is called with the number of iterations finished
            since its last call.
        settings: of the method (the fields of its class), such as ``epsilon`` or ``iterations``.

    Raises:
        HarnessError: an argument is wrong, or the folder holds another run or a damaged one.
    """
    domain = registry.load(domain) if isinstance(domain, str) else domain
    engine = engines.choose(engine, domain)
    subject = tunable(policy, domain)
    objective.check(measure, seed)
    _check_counts(horizon=horizon, final_episodes=final_episodes)
    if resume and out is None:
        raise HarnessError("resume needs the folder of the run: out")
    search, start = _method(method, subject, seed, settings), subject.text(subject.start)
    parameters = {
        "domain": domain.name,
        "shaping": domain.shaping,
        "policy": start,
        "method": method,
        "measure": measure,
        "seed": seed,
        "horizon": horizon,
        "final_episodes": final_episodes,
        **settings_of(search),
        "model_hash": domain.model_hash,
    }
    config = {"run": parameters, "versions": host.versions("numpy", "numba", "cma"), "engine": engine}
    kept = journal.Journal(subject.names, None if out is None else Path(out))
    kept.begin(config, resume)
    with Bar(progress, desc=f"{method} from {brief(start)}", unit=" iterations") as bar:
        played = Episodes(domain, subject, seed, horizon, measure, engine, workers)

        def show(theta: Vector, value: float) -> None:
            bar.set_postfix_str(f"θ {' '.join(f'{x:.3f}' for x in theta)}, {measure} {value:.2f}")
            bar.update()

        stopped, last = climb(search, played, kept, show)
    best = _best(subject, search.theta, played, last, final_episodes)
    if out is not None and isinstance(subject, Constants):
        files.replace_text(Path(out) / "best.txt", best.policy)
    kept.finish({"stopped": stopped, "policy": best.policy, "theta": best.theta, **_scores(best)})
    return Tuned(method, config, kept.table(), best, stopped)


def brief(policy: str) -> str:
    """What names a policy, on one line: a program by its first statement."""
    first, _, rest = policy.partition("\n")
    return f"the program '{first} …'" if rest or "\n" in policy else policy


def _method(name: str, subject: Tunable, seed: int, settings: Mapping[str, float]) -> Method:
    if name not in METHODS:
        raise HarnessError(f"no method {quoted(name)}{nearest(name, METHODS)} (known: {', '.join(METHODS)})")
    return configure(METHODS[name], subject, seed, settings)


def _check_counts(**counts: int) -> None:
    for name, count in counts.items():
        if count < 1:
            raise HarnessError(f"{name} must be 1 or more, not {count}")


def resume(folder: str | Path, **given: Any) -> Tuned:
    """Go on with the run in a folder, with the parameters that it was started with.

    Args:
        folder: of the run.
        given: arguments of :func:`tune`, which must be those of the run where they decide its numbers.

    Raises:
        HarnessError: there is no run, it is damaged, it was started with other parameters, or with objects that only a
            program can make anew (call :func:`tune` with them and ``resume=True``).
    """
    stored = journal.read_parameters(Path(folder))
    stored.pop("model_hash")
    if "method" in given:  # before the settings, which belong to it
        journal.check_same({"method": stored["method"]}, {"method": given["method"]}, Path(folder))
    named, shaping = stored.pop("domain"), stored.pop("shaping")
    if "policy" not in given:
        policies.check_from_data(stored["policy"])
    loaded = registry.load(given.pop("domain")) if "domain" in given else registry.load_from_data(named)
    domain = loaded.shaped(shaping)
    return tune(domain, out=folder, resume=True, **(stored | given))


def climb(
    search: Method,
    played: Objective,
    kept: journal.Journal,
    show: Callable[[Vector, float], object] = lambda theta, value: None,
) -> tuple[str, tuple[int, int]]:
    """Run a method to its end; why it stopped, and the last iteration's first episode and their number at a point."""
    for iteration in range(search.iterations):
        theta, ask = search.theta, search.ask(iteration)
        known = kept.answers(ask)
        if known is None:
            known = _means(played(ask))
        values, sems = known
        move = search.tell(iteration, ask, values)
        kept.tell(theta, ask, values, sems, move)
        show(search.theta, float(values.mean()))
        if move.stop:
            break
    last = int(ask.first.min()), int(ask.first.max() - ask.first.min()) + ask.episodes
    return move.stop or f"all {search.iterations} iterations are done", last


def _means(returns: Vector) -> tuple[Vector, Vector]:
    values, sems = np.array([mean_and_sem(row) for row in returns]).T
    return values, sems


def _best(subject: Tunable, theta: Vector, played: Episodes, last: tuple[int, int], episodes: int) -> Best:
    """The result, rounded, played again on the last iteration's episodes and on fresh ones."""
    rounded = np.clip(np.round(theta, DECIMALS), subject.lower, subject.upper)
    first, count = last
    training = played.play(rounded, count, rng.TRAINING + played.seed, first).score
    true = replace(played, domain=played.domain.shaped("none"))
    fresh = true.play(rounded, episodes, rng.HELD_OUT + played.seed).score
    named = {name: float(x) for name, x in zip(subject.names, rounded, strict=True)}
    return Best(named, subject.text(rounded), fresh, training)


def _scores(best: Best) -> dict[str, Any]:
    return {"training": best.training._asdict(), "fresh": best.score._asdict()}
