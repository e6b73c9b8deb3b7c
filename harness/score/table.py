"""What a comparison table is made of."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from harness.errors import HarnessError

COLUMNS = (
    "policy",
    "mean",
    "sem",
    "discounted_mean",
    "discounted_sem",
    "share_low",
    "share_high",
    "steps_mean",
    "success_rate",
    "ci_low",
    "ci_high",
    "reference",
    "engine",
    "seed",
    "horizon",
    "domain_version",
    "kind",
    "optimum_low",
    "optimum_high",
    "episodes",
    "domain",
)
"""Columns of every table; ``kind`` is ``policy`` or ``upper bound``, ``reference`` the published figure or None; the
share of the optimum that the discounted mean earns is an interval, as the optimum is known by its bounds. The
first and the last few are what pandas shows where there is little room."""

SHARES = ("share_low", "share_high", "optimum_low", "optimum_high")
"""Those that are empty where no bounds of the optimum are known."""

DIFFERENCES = (
    "against",
    "pairs",
    "discounted_difference",
    "discounted_difference_sem",
    "discounted_improvement",
    "discounted_p_value",
    "improvement",
    "difference",
    "difference_sem",
    "p_value",
)
"""Further columns of a comparison ``against`` a policy: the fields of :class:`~harness.score.paired.Paired` for
discounted and for undiscounted returns. The p-values are adjusted by Holm for all the tests of the table."""

DETAILS = "details"
"""Further column where a policy says more of itself than its name (a Julia file): packages, versions, settings."""


HOW = "how"
SAMPLED, EXACT, INTERVAL = "sampled", "exact", "interval"
EXACTNESS = (HOW, "discounted_low", "discounted_high")
"""Further columns of a comparison with ``exact=True``: how a row's returns are known, and what the discounted mean
lies between (the undiscounted one: ``ci_low`` and ``ci_high``). That is a 95 % interval of what is ``sampled``, one and
the same number where it is ``exact``, and proven bounds of an ``interval``, whose mean is their middle and whose errors
are empty. Rows that are not sampled have no engine, seed and episodes."""


class Table(pd.DataFrame):
    """What :func:`harness.compare` returns: a DataFrame that a notebook shows as the command does.

    What is made from it, such as a choice of its columns, is a plain DataFrame.
    """

    def _repr_html_(self) -> str:
        from harness.score.rendering import html

        return html(self)


def check_columns(table: pd.DataFrame, names: Sequence[str] = COLUMNS) -> None:
    """Check that a table has columns of these names, by default those that every comparison has.

    Raises:
        HarnessError: a column is missing.
    """
    if missing := [name for name in names if name not in table]:
        raise HarnessError(f"this is no whole comparison table: it has no column {missing[0]}")


def by_domain(table: pd.DataFrame) -> list[pd.DataFrame]:
    """The parts of a table, one a domain."""
    return [part for _, part in table.groupby("domain", sort=False)]
