"""The published figures with ours beside them, where the rules are the same, and what became of each."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

import pandas as pd

from harness import registry
from harness.errors import HarnessError, nearest, quoted
from harness.score import bounds, published
from harness.score.verdicts import NOT_RUN, OTHER_RULES, compared, within
from harness.solver import solution

COLUMNS = (
    *("problem", "method", "quantity", "value", "error", "ours", "ours_error", "gap", "combined_error", "verdict"),
    *("why", "optimum_low", "optimum_high", "rules", "budget", "source", "place", "seen"),
    *("domain", "policy", "run", "printed"),
)
"""Columns of :func:`literature`; :mod:`harness.score.published` says what those of the data file are."""


def literature(domain: str | None = None) -> pd.DataFrame:
    """Every published figure that was found, what ours gives on the same rules, and a verdict.

    Figures of ours were measured once, by the command in ``run``; bounds are read from the solutions that ship. Where
    rules differ, or nothing was run, ``why`` gives the reason and ``ours`` is empty; what a method that is not here is
    said to earn is judged by the optimum.

    Args:
        domain: keep what concerns a domain of ours, or a problem by its published name; None: keep all.

    Returns:
        One row a figure, columns :data:`COLUMNS`: ``value`` and ``error`` as published (``error``: standard error, NaN
        where none was; ``printed``: the value with its decimals), ``gap`` ours less theirs with ``combined_error``,
        ``verdict`` one of :data:`~harness.score.verdicts.VERDICTS`. ``place`` is where the figure was read, ``seen``
        how: ``source``, ``quoted`` or ``recalled``. ``optimum_low`` and ``optimum_high`` bound the optimal discounted
        return on the rules of ours.

    Raises:
        HarnessError: nothing published concerns that domain.
    """
    figures = _concerning(published.figures(), domain)
    known = {name: _optimum(name) for name in set(figures["domain"])}
    rows = [_row(figure, known[figure["domain"]]) for figure in figures.to_dict("records")]
    return pd.DataFrame(rows, columns=list(COLUMNS))


def _concerning(figures: pd.DataFrame, domain: str | None) -> pd.DataFrame:
    if domain is None:
        return figures
    names = list(dict.fromkeys([*filter(None, figures["domain"]), *figures["problem"]]))
    kept = figures[(figures["domain"] == domain) | figures["problem"].isin([domain, _problem(domain)])]
    if kept.empty:
        raise HarnessError(f"nothing published on {quoted(domain)}{nearest(domain, names)} (known: {', '.join(names)})")
    return kept


def _problem(domain: str) -> str | None:
    """What the literature calls a domain of ours, whatever the rules: its title up to the comma after the sizes."""
    if domain not in registry.names():
        return None
    return re.split(r",(?![^(]*\))", registry.load(domain).title)[0]


def _optimum(domain: str) -> dict[str, float]:
    found = bounds.optimum(registry.load(domain)) if domain else None
    return {} if found is None else {"optimum_low": found.low, "optimum_high": found.high}


def _row(figure: Mapping[Any, Any], optimum: dict[str, float]) -> dict[str, Any]:
    more = optimum if figure["quantity"] == published.RETURN else {}
    return {**figure, "value": float(figure["value"]), "printed": figure["value"], **more, **_judged(figure, more)}


def _judged(figure: Mapping[Any, Any], optimum: Mapping[str, float]) -> dict[str, Any]:
    """The cells that depend on ours."""
    nothing = {"ours": math.nan, "ours_error": math.nan, "run": ""}
    if figure["differs"]:
        return {**nothing, "verdict": OTHER_RULES, "why": figure["differs"]}
    if not figure["run"]:
        bounded = within(figure["value"], figure["error"], optimum["optimum_high"]) if optimum else NOT_RUN
        return {**nothing, "verdict": bounded, "why": figure["note"]}
    ours = _stored_lower(figure["domain"], figure["policy"]) if math.isnan(figure["ours"]) else figure["ours"]
    verdict, gap, error = compared(figure["value"], figure["error"], ours, figure["ours_error"])
    return {"ours": ours, "gap": gap, "combined_error": error, "verdict": verdict, "why": figure["note"]}


def _stored_lower(domain: str, policy: str) -> float:
    """What a policy that ships is proven to earn at least: the lower bound that its solver ended with."""
    path = registry.policy_path(domain, policy)
    return float(solution.read(path, registry.load(domain), *solution.OWN_KINDS).record["lower"])
