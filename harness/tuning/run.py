"""A tuning run: a method asks, episodes answer, a journal remembers; the best is chosen, and scored on fresh ones."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from harness import engine as engines
from harness import files, host, locking, registry
from harness import policy as policies
from harness.errors import HarnessError, nearest, quoted
from harness.expectation.smooth.forward import softened
from harness.model.domain import Domain
from harness.play import population
from harness.play.evaluation import EPISODES, HORIZON, mean_and_sem
from harness.progress import Bar, Progress
from harness.tuning import journal, objective
from harness.tuning.ascent import ForwardDifference
from harness.tuning.autodiff import Autodiff
from harness.tuning.cmaes import CmaEs
from harness.tuning.constants import Constants
from harness.tuning.lines import Lines
from harness.tuning.method import MOST_EPISODES, MOST_STEPS, Method, check_number, configure, settings_of
from harness.tuning.objective import Episodes, Objective
from harness.tuning.outcome import Tuned, brief, outcome, record
from harness.tuning.score import ScoreFunction
from harness.tuning.spsa import Spsa
from harness.tuning.tunable import Tunable, Vector, tunable

METHODS: dict[str, type[Any]] = {
    "gradient": ForwardDifference,
    "spsa": Spsa,
    "score": ScoreFunction,
    "cmaes": CmaEs,
    "lines": Lines,
    "autodiff": Autodiff,
}
"""Ways uphill by name; their fields are their settings."""

COUNTS = {"validation_episodes": EPISODES, "final_episodes": EPISODES}
"""What every run can be told besides, and the defaults."""


@locking.alone
def tune(
    domain: Domain | str,
    policy: str | Tunable,
    *,
    method: str = "gradient",
    measure: str = "return",
    seed: int = 0,
    horizon: int = HORIZON,
    validation_episodes: int = COUNTS["validation_episodes"],
    final_episodes: int = COUNTS["final_episodes"],
    engine: str = "auto",
    workers: int | None = None,
    out: str | Path | None = None,
    resume: bool = False,
    progress: Progress = False,
    **settings: float,
) -> Tuned:
    """Tune the numbers in a policy.

    The result is the best of the start and all that was visited, not where the method ended; the start where nothing
    was better. How it is chosen, and at what cost, see :mod:`harness.tuning.choosing`.

    Args:
        domain: a domain or its name. Its shaping counts while tuning, never in the choice and in the final scores.
        policy: a policy string, whose numbers are the start (``belief:0.6``, ``program:FILE``), a program's text, or an
            object of the Tunable protocol.
        method: ``gradient`` (the paper's), ``spsa``, ``score``, ``cmaes``, ``lines`` or ``autodiff``.
        measure: what to maximise, the undiscounted ``return`` within the horizon or the ``discounted`` one.
        seed: of the run. Its episodes lie far from those that people score with.
        horizon: steps after which an episode is truncated.
        validation_episodes: those that choose the result; no iterate has seen them.
        final_episodes: fresh ones for the final scores.
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
    check_number("horizon", horizon, True, 1, MOST_STEPS)
    check_number("validation_episodes", validation_episodes, True, 2, MOST_EPISODES)
    check_number("final_episodes", final_episodes, True, 2, MOST_EPISODES)
    if resume and out is None:
        raise HarnessError("resume needs the folder of the run: out")
    search, start = _method(method, domain, subject, seed, settings), subject.text(subject.start)
    _check_memory(domain, subject, search, horizon, max(validation_episodes, final_episodes))
    parameters = {
        "domain": domain.name,
        "shaping": domain.shaping,
        "policy": start,
        "method": method,
        "measure": measure,
        "seed": seed,
        "horizon": horizon,
        "validation_episodes": validation_episodes,
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
        history = kept.table()
        result = Tuned(method, config, history, *outcome(played, parameters, history, search.theta, last), stopped)
    if out is not None and isinstance(subject, Constants):
        files.replace_text(Path(out) / "best.txt", result.best.policy)
    kept.finish(record(result))
    return result


def _method(name: str, domain: Domain, subject: Tunable, seed: int, settings: Mapping[str, float]) -> Method:
    if name not in METHODS:
        raise HarnessError(f"no method {quoted(name)}{nearest(name, METHODS)} (known: {', '.join(METHODS)})")
    first = configure(METHODS[name], subject, seed, settings).ask(0)  # of a method of its own: asking may draw
    if (episodes := len(first.points) * first.episodes) > MOST_EPISODES:
        raise HarnessError(
            f"an iteration would play {episodes:,} episodes ({len(first.points):,} points of {first.episodes:,}), and "
            f"{MOST_EPISODES:,} are the most; take fewer"
        )
    if first.soft is not None:
        softened(domain, subject.policy(subject.start), len(subject.start))
    return configure(METHODS[name], subject, seed, settings)


def _check_memory(domain: Domain, subject: Tunable, search: Method, horizon: int, others: int) -> None:
    if isinstance(subject, Constants):  # these are played together, their random numbers made beforehand
        first = copy.deepcopy(search).ask(0)
        host.check_memory(*population.memory(domain, len(first.points), first.episodes, horizon))
        host.check_memory(*population.memory(domain, 1, others, horizon))


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
            known = _means(played(ask)) if ask.soft is None else (played.smooth(ask), np.zeros(1))
        values, sems = known
        move = search.tell(iteration, ask, values)
        kept.tell(theta, ask, values, sems, move)
        show(search.theta, float(values[: len(ask.points)].mean()))
        if move.stop:
            break
    last = int(ask.first.min()), int(ask.first.max() - ask.first.min()) + ask.episodes
    return move.stop or f"all {search.iterations} iterations are done", last


def _means(returns: Vector) -> tuple[Vector, Vector]:
    values, sems = np.array([mean_and_sem(row) for row in returns]).T
    return values, sems
