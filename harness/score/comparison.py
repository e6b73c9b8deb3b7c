"""The comparison table: many policies on one domain or several, each a row with its uncertainty and origin."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple, TypeGuard

import pandas as pd

from harness import engine as engines
from harness import host, registry
from harness import policy as specs
from harness.errors import HarnessError, PolicyError
from harness.expectation.acting import NotExact
from harness.expectation.forward import exact as expected_return
from harness.model.domain import Domain
from harness.play.evaluation import EPISODES, HORIZON, KEPT, Z95, Evaluation, Score, check_played, evaluate
from harness.policy import Policy
from harness.policy.base import whole
from harness.progress import Bar, Progress
from harness.score import bounds, published
from harness.score.paired import Paired, holm, paired
from harness.score.table import COLUMNS, DETAILS, DIFFERENCES, EXACT, EXACTNESS, HOW, INTERVAL, SAMPLED, Table
from harness.solver.solution import Bounds


def compare(
    domain: Domain | str | Sequence[Domain | str],
    policies: str | Policy | Sequence[str | Policy] | Mapping[str, str | Policy] | None = None,
    *,
    against: str | Policy | None = None,
    episodes: int | None = None,
    seed: int = 0,
    horizon: int = HORIZON,
    engine: str = "auto",
    workers: int | None = None,
    exact: bool = False,
    progress: Progress = False,
) -> pd.DataFrame:
    """Score policies side by side, on a domain or on several.

    Args:
        domain: a domain or its name, or several. Scores are of the true reward, whatever a domain's shaping.
        policies: policy strings or policy objects, one or several, or both by the names that the table is to show; by
            default all that a domain knows, with the bound ``optimum``, or ``mdp``.
        against: a policy that every other one is compared with, episode by episode; it is played too where it is not
            among the ``policies``.
        episodes: of every policy; by default 10,000, and 1,000 for policies that plan by simulation (``rollout``).
        seed: all policies meet the same initial states and the same random numbers.
        horizon: steps after which an episode is truncated.
        engine: ``tables``, ``julia`` or ``auto``.
        workers: threads of the tables engine.
        exact: compute expected returns instead of sampling them, of all policies that allow it (:func:`harness.exact`).
        progress: True for a bar on a terminal for each policy that takes longer than two seconds, or a function that is
            called with the number of episodes finished since its last call.

    Returns:
        One row a policy and domain, columns :data:`~harness.score.table.COLUMNS`; with ``against`` also
        :data:`~harness.score.table.DIFFERENCES`, with ``exact`` :data:`~harness.score.table.EXACTNESS`, and with a
        Julia file :data:`~harness.score.table.DETAILS`.

    Raises:
        HarnessError: something in the arguments is wrong; nothing is run before all of them have been checked.
        Interrupted: Ctrl-C was pressed; its ``table`` holds the rows finished by then.
    """
    if exact and against is not None:
        raise HarnessError("exact rows have no episodes to compare one by one: leave out exact, or against")
    settings = _Settings(episodes, seed, horizon, workers, exact, progress)
    entries = [entry for each in domains_of(domain) for entry in entries_of(each, policies, against, engine)]
    _check(entries, settings, keep=against is not None)
    rows: list[_Row] = []
    try:
        for entry in entries:
            row = _row(entry, settings, keep=against is not None)
            rows.append(row)
    except KeyboardInterrupt:
        raise Interrupted(_table(rows, entries, exact)) from None
    return _table(rows, entries, exact)


class Interrupted(KeyboardInterrupt):
    """Ctrl-C during a comparison; ``table`` holds the rows finished by then."""

    def __init__(self, table: pd.DataFrame) -> None:
        """``table``: as :func:`compare` would return it."""
        super().__init__()
        self.table = table


class _Settings(NamedTuple):
    episodes: int | None
    seed: int
    horizon: int
    workers: int | None
    exact: bool
    progress: Progress


class Entry(NamedTuple):
    """A row to be."""

    domain: Domain
    engine: str
    name: str
    policy: Policy | None
    """None for the bound."""
    reference: bool
    """Whether the others are compared with it."""
    optimum: Bounds | None
    """Of its domain; where none are stored, those that its policy came with."""


class _Row(NamedTuple):
    entry: Entry
    cells: dict[str, Any]
    result: Evaluation | None
    """None for the bound, and where nothing asks for single episodes."""


def domains_of(given: Domain | str | Sequence[Domain | str]) -> list[Domain]:
    """The domains, each once, with their true reward.

    Raises:
        HarnessError: there is no such domain, none at all, or one twice.
    """
    found = [each if isinstance(each, Domain) else registry.load(each) for each in _several(given)]
    names = [each.name for each in found]
    if not names:
        raise HarnessError("there is no domain to compare policies on")
    if twice := [name for name in names if names.count(name) > 1]:
        raise HarnessError(f"{twice[0]} is given twice; name every domain once")
    return [each.shaped("none") for each in found]


def _several(given: Any) -> list[Any]:
    """One thing or many of it, as a list."""
    return [given] if isinstance(given, str) or not isinstance(given, Iterable) else list(given)


def entries_of(domain: Domain, policies: Any, against: str | Policy | None, engine: str) -> list[Entry]:
    """The rows of one domain to be, all checked; arguments are those of :func:`compare`.

    Raises:
        HarnessError: something in the arguments is wrong.
    """
    engine = engines.choose(engine, domain)
    made = _named(policies, domain, engine)
    if not made:
        raise HarnessError("there are no policies to compare")
    reference = None if against is None else _position(against, made, domain, engine)
    known = bounds.optimum(domain)
    return [
        Entry(domain, engine, name, policy, k == reference, known or bounds.of_policy(policy))
        for k, (name, policy) in enumerate(made)
    ]


def _named(policies: Any, domain: Domain, engine: str) -> list[tuple[str, Policy | None]]:
    if policies is None:
        policies = [*specs.default_specs(domain), *bounds.default(domain)]
    if isinstance(policies, Mapping):
        return [(str(name), _made(policy, domain, engine)[1]) for name, policy in policies.items()]
    return [_made(policy, domain, engine) for policy in _several(policies)]


def _made(policy: str | Policy, domain: Domain, engine: str) -> tuple[str, Policy | None]:
    if _is_bound(policy):
        return policy, None
    specs.check_engine(policy, engine)
    return specs.named(policy, domain)


def _is_bound(policy: str | Policy) -> TypeGuard[str]:
    return isinstance(policy, str) and policy in bounds.NAMES


def _position(against: str | Policy, made: list[tuple[str, Policy | None]], domain: Domain, engine: str) -> int:
    """Which row the others are compared with; it is added to ``made`` where it is not there."""
    known = [name if isinstance(against, str) else policy for name, policy in made]
    if against not in known:
        added = _made(against, domain, engine)
        against = added[0] if isinstance(against, str) else against
        if against not in known:
            made.append(added)
            known.append(against)
    position = known.index(against)
    if made[position][1] is None:
        raise PolicyError(f"'{against}' is a bound, which plays no episodes; compare against a policy")
    return position


def _row(entry: Entry, settings: _Settings, *, keep: bool) -> _Row:
    """A row played; ``keep`` the single episodes."""
    if entry.policy is None:
        return _Row(entry, bound_cells(entry, settings.horizon), None)
    if settings.exact and (cells := _exact_cells(entry, entry.policy, settings)):
        return _Row(entry, cells, None)
    result = _played(entry, entry.policy, settings)
    return _Row(entry, played_cells(entry, result), result if keep else None)


def _exact_cells(entry: Entry, policy: Policy, settings: _Settings) -> dict[str, Any] | None:
    """A row computed; None where it can only be sampled."""
    try:
        found = expected_return(entry.domain, policy, horizon=settings.horizon, progress=settings.progress is True)
    except NotExact:
        return None
    low, high = (bounds.share(end, entry.optimum) for end in found.discounted)
    error = 0.0 if found.is_exact else math.nan
    return {
        **_origin(entry),
        "kind": "policy",
        "horizon": settings.horizon,
        HOW: EXACT if found.is_exact else INTERVAL,
        "mean": found.mean.middle,
        "sem": error,
        "ci_low": found.mean.low,
        "ci_high": found.mean.high,
        "discounted_mean": found.discounted.middle,
        "discounted_sem": error,
        "discounted_low": found.discounted.low,
        "discounted_high": found.discounted.high,
        "steps_mean": found.steps.middle,
        "success_rate": found.success.middle,
        **low,
        **({"share_high": high["share_high"]} if high else {}),
        "reference": _reference(entry, settings.horizon),
    }


def _played(entry: Entry, policy: Policy, settings: _Settings) -> Evaluation:
    count = _episodes(settings.episodes, policy)
    with Bar(settings.progress, count, desc=entry.name, unit="episode", delay=2) as bar:
        return evaluate(
            entry.domain,
            policy,
            episodes=count,
            seed=settings.seed,
            horizon=settings.horizon,
            engine=entry.engine,
            workers=settings.workers,
            progress=bar.update,
        )


def _episodes(given: int | None, policy: Policy) -> int:
    return min(EPISODES, whole(policy, "max_episodes", EPISODES)) if given is None else given


def _check(entries: list[Entry], settings: _Settings, *, keep: bool) -> None:
    """Check, before anything is played, the numbers and the memory of all rows together."""
    counts = [_episodes(settings.episodes, entry.policy) for entry in entries if entry.policy is not None]
    for count in counts:
        check_played(episodes=count, seed=settings.seed, horizon=settings.horizon)
    host.workers(settings.workers)
    if keep:
        host.check_memory(f"to compare {len(counts)} policies episode by episode", sum(counts) * KEPT)


def played_cells(entry: Entry, result: Evaluation) -> dict[str, Any]:
    """The row of a policy that was played, by its columns."""
    return {
        **_origin(entry),
        "kind": "policy",
        "engine": result.engine,
        "seed": result.seed,
        "horizon": result.horizon,
        **result.score._asdict(),
        **_sampled(result.score),
        **bounds.share(result.score.discounted_mean, entry.optimum),
        **_details(entry.policy),
        "reference": _reference(entry, result.horizon),
    }


def _details(policy: Policy | None) -> dict[str, str]:
    """What a policy says of its origin, where its name does not say it all."""
    details = getattr(policy, "details", None)
    return {DETAILS: details} if isinstance(details, str) else {}


def _sampled(score: Score) -> dict[str, Any]:
    """The cells of :data:`EXACTNESS`, which only a comparison with exact rows shows."""
    half = Z95 * score.discounted_sem
    low, high = score.discounted_mean - half, score.discounted_mean + half
    return {HOW: SAMPLED, "discounted_low": low, "discounted_high": high}


def bound_cells(entry: Entry, horizon: int) -> dict[str, Any]:
    """The row of a bound, by its columns."""
    return {
        **_origin(entry),
        "kind": "upper bound",
        "horizon": horizon,
        **bounds.cells(entry.domain, entry.name, horizon),
    }


def _origin(entry: Entry) -> dict[str, Any]:
    return {"domain": entry.domain.name, "domain_version": entry.domain.version, "policy": entry.name}


def _reference(entry: Entry, horizon: int) -> dict[str, Any] | None:
    found = published.reference(entry.domain.name, entry.name, horizon)
    if found is None or not registry.ships(entry.domain):
        return None
    return {"discounted_mean": found.value, "error": found.error, "source": found.source}


def _table(rows: list[_Row], entries: list[Entry], exact: bool) -> Table:
    """The rows finished, of all that were to be."""
    cells = [row.cells | more for row, more in zip(rows, _differences(rows, entries), strict=True)]
    compared = any(entry.reference for entry in entries)
    told = any(DETAILS in each for each in cells)
    more = [*(DIFFERENCES if compared else ()), *(EXACTNESS if exact else ()), *([DETAILS] if told else ())]
    return Table(cells, columns=[*COLUMNS, *more])


def _differences(rows: list[_Row], entries: list[Entry]) -> list[dict[str, Any]]:
    """The cells of :data:`DIFFERENCES` for every row; none for the reference itself and for bounds."""
    references = {row.entry.domain.name: row for row in rows if row.entry.reference}
    found = [_pair(row, references.get(row.entry.domain.name)) for row in rows]
    tests = [each.p_value for pair in found for each in pair]
    # Two tests for every row that is compared, those included that Ctrl-C left undone.
    family = 2 * sum(entry.policy is not None and not entry.reference for entry in entries)
    adjusted = iter(holm(tests, family))
    cells = []
    for row, pair in zip(rows, found, strict=True):
        more: dict[str, Any] = {"against": references[row.entry.domain.name].entry.name} if pair else {}
        for prefix, each in zip(("", "discounted_"), pair, strict=False):
            more |= {"pairs": each.pairs, **_difference(prefix, each, next(adjusted))}
        cells.append(more)
    return cells


def _pair(row: _Row, reference: _Row | None) -> list[Paired]:
    """Undiscounted and discounted, where there is something to compare."""
    if reference is None or reference is row or row.result is None or reference.result is None:
        return []
    a, b = row.result, reference.result
    return [paired(a.returns, b.returns), paired(a.discounted, b.discounted)]


def _difference(prefix: str, pair: Paired, p_value: float) -> dict[str, float]:
    return {
        f"{prefix}difference": pair.difference,
        f"{prefix}difference_sem": pair.sem,
        f"{prefix}improvement": pair.improvement,
        f"{prefix}p_value": p_value,
    }
