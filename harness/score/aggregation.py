"""Several domains in one figure: returns on a common scale, with intervals.

After Agarwal et al. 2021, Deep Reinforcement Learning at the Edge of the Statistical Precipice (rliable), with one
difference: their runs are few, our episodes thousands, so that what resampling does to a mean is known, normal with its
standard error. It is drawn from that: no episode has to be at hand, and a table read from a file will do.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from harness.engine import rng
from harness.errors import HarnessError, check_whole
from harness.score.table import by_domain, check_columns

FLOOR = "random-legal"
"""The policy whose return is 0 on the common scale; the lowest upper bound is 1."""

BOUND_KIND = "upper bound"
"""What the column ``kind`` says of a bound."""

_MOST_RESAMPLES = 1_000_000
_MEASURES = {"": ("mean", "sem"), "discounted_": ("discounted_mean", "discounted_sem")}
_SUMMARIES: dict[str, Callable[..., NDArray[np.float64]]] = {"mean": np.mean, "median": np.median}


def aggregate(table: pd.DataFrame, *, resamples: int = 2_000, seed: int = 0) -> pd.DataFrame:
    """Policies over all domains of a table.

    Mean returns are scaled so that in every domain ``random-legal`` has 0 and the lowest upper bound is 1. Intervals
    are 95 % percentile intervals of a bootstrap stratified by domain: every mean is drawn anew, that of
    ``random-legal`` too; the bounds are fixed.

    Args:
        table: what :func:`harness.compare` returns for several domains, or several such tables one below the other.
        resamples: draws behind the intervals.
        seed: of the draws.

    Returns:
        One row for every policy that all domains have: ``policy``, ``domains`` (their number), ``mean`` and ``median``
        over the domains with ``mean_low``, ``mean_high``, …, and the same of the discounted returns,
        ``discounted_mean``, …; NaN where a domain has no bound of that return.

    Raises:
        HarnessError: a domain has no row ``random-legal``, no upper bound, or two rows of one name.
    """
    check_whole("resamples", resamples, 1, _MOST_RESAMPLES)
    check_whole("seed", seed, 0, 2**64 - 1)
    check_columns(table, ("domain", "policy", "kind", *itertools.chain(*_MEASURES.values())))
    parts = [_checked(part) for part in by_domain(table)]
    if not parts:
        raise HarnessError("there are no rows to aggregate")
    names = [part.index[part["kind"] == "policy"] for part in parts]
    shared = [name for name in names[0] if all(name in others for others in names)]
    columns: dict[str, object] = {"policy": shared, "domains": len(parts)}
    for prefix, (mean, sem) in _MEASURES.items():
        scaled = [
            _scaled(part, mean, sem, resamples, rng.generator(seed, rng.RESAMPLING, k))[shared].to_numpy()
            for k, part in enumerate(parts)
        ]
        for name, summary in _SUMMARIES.items():
            columns |= _interval(f"{prefix}{name}", summary(np.stack(scaled), axis=0))
    return pd.DataFrame(columns)


def _checked(part: pd.DataFrame) -> pd.DataFrame:
    """The rows of one domain, by policy."""
    domain = part["domain"].iloc[0]
    rows = part.set_index("policy")
    names = rows.index[rows["kind"] == "policy"]
    if FLOOR not in names:
        raise HarnessError(f"{domain} has no row of {FLOOR} to scale returns by; compare with it")
    if part.loc[part["kind"] == BOUND_KIND, "discounted_mean"].isna().all():
        raise HarnessError(f"{domain} has no upper bound to scale returns by; compare with 'mdp' where there is one")
    if not names.is_unique:
        raise HarnessError(f"{domain} has two rows named {names[names.duplicated()][0]}; give them names of their own")
    return rows


def _scaled(rows: pd.DataFrame, mean: str, sem: str, resamples: int, draws: np.random.Generator) -> pd.DataFrame:
    """Scaled returns of a domain, a column a policy; the first row is the table's, the others are drawn."""
    played = rows[rows["kind"] == "policy"]
    noise = draws.standard_normal((1 + resamples, len(played)))
    noise[0] = 0
    means = pd.DataFrame(
        played[mean].to_numpy(float) + played[sem].to_numpy(float) * noise, columns=played.index.tolist()
    )
    bound = float(rows.loc[rows["kind"] == BOUND_KIND, mean].astype(float).min())
    return means.sub(means[FLOOR], axis=0).div(bound - means[FLOOR], axis=0)


def _interval(name: str, values: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """The columns of a summary from its (1 + resamples, policies) values."""
    low, high = np.quantile(values[1:], (0.025, 0.975), axis=0)
    return {name: values[0], f"{name}_low": low, f"{name}_high": high}
