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


def coverage(table: pd.DataFrame, *, resamples: int = 2_000, seed: int = 0) -> pd.DataFrame:
    """What every policy earns of what there is, over those domains of a table that it plays.

    Two measures of the mean discounted return: its ``share`` of the optimal value, where that is above 0; and where it
    lies on the ``scale`` of :func:`aggregate`, whose 1 is the optimal value. The optimum is known by its bounds: a
    figure is what is proven at least, with the upper bound, and its interval ends at the upper percentile of what the
    lower bound gives. The other end, and the draws, are those of :func:`aggregate`.

    Args:
        table: what :func:`harness.compare` returns for several domains, or several such tables one below the other.
        resamples: draws behind the intervals.
        seed: of the draws.

    Returns:
        One row a policy, those that play most domains first: ``policy``, ``played`` (number of domains), and of each
        measure ``share_domains`` (the number of those that have a figure), ``share_mean`` and ``share_iqm`` (the mean
        of the middle half of the domains) with ``share_mean_low``, ``share_mean_high``, …; NaN where none has one.

    Raises:
        HarnessError: a number is out of range, a column is missing, or a domain has two rows of one name.
    """
    check_whole("resamples", resamples, 1, _MOST_RESAMPLES)
    check_whole("seed", seed, 0, 2**64 - 1)
    check_columns(table, ("domain", "policy", "kind", "discounted_mean", "discounted_sem", *_OPTIMUM))
    parts = [_by_policy(part) for part in by_domain(table[table["kind"] == "policy"])]
    found: dict[str, dict[str, list[_Ends]]] = {}
    for k, part in enumerate(parts):
        means = _drawn(part, "discounted_mean", "discounted_sem", resamples, rng.generator(seed, rng.RESAMPLING, k))
        for measure, floor in (("share", 0.0), ("scale", means.get(FLOOR))):
            ends = _between(part, means, floor)
            for policy in part.index:
                kept = found.setdefault(policy, {}).setdefault(measure, [])
                kept += [(ends[0][policy].to_numpy(), ends[1][policy].to_numpy())] if ends else []
    played = {policy: sum(policy in part.index for part in parts) for policy in found}
    rows = [{"policy": policy, "played": played[policy], **_covered(measures)} for policy, measures in found.items()]
    columns = ["policy", "played", *_covered({"share": [], "scale": []})]
    return pd.DataFrame(rows, columns=columns).sort_values(
        ["played", "scale_mean"], ascending=False, kind="stable", ignore_index=True
    )


_OPTIMUM = ("optimum_low", "optimum_high")
_Ends = tuple[NDArray[np.float64], NDArray[np.float64]]
"""(1 + resamples,) the least and the most that a figure can be, as the optimum is known by its bounds."""


def _between(
    part: pd.DataFrame, means: pd.DataFrame, floor: pd.Series | float | None
) -> tuple[pd.DataFrame, pd.DataFrame] | None:
    """Means on a scale from a floor to the optimum, by its upper and its lower bound; None where there is none."""
    low, high = (float(part[name].astype(float).max()) for name in _OPTIMUM)
    if floor is None or not np.all(low > np.asarray(floor)):  # NaN: no bounds are known
        return None
    above = means.sub(floor, axis=0)
    least, most = (above.div(bound - floor, axis=0) for bound in (high, low))
    return least.where(least < most, most), most.where(least < most, least)


def _covered(measures: dict[str, list[_Ends]]) -> dict[str, float]:
    """The columns of each measure, from its figures in some domains."""
    columns: dict[str, float] = {}
    for measure, ends in measures.items():
        columns[f"{measure}_domains"] = len(ends)
        least, most = (np.stack([each[side] for each in ends]) if ends else np.full((1, 2), np.nan) for side in (0, 1))
        for name, summary in (("mean", np.mean), ("iqm", interquartile_mean)):
            low, high = summary(least, axis=0), summary(most, axis=0)
            columns |= {
                f"{measure}_{name}": float(low[0]),
                f"{measure}_{name}_low": float(np.quantile(low[1:], 0.025)),
                f"{measure}_{name}_high": float(np.quantile(high[1:], 0.975)),
            }
    return columns


def interquartile_mean(values: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    """Mean of the middle half along an axis: a quarter of the values, rounded down, is left out at either end."""
    rising = np.sort(values, axis=axis)
    cut = rising.shape[axis] // 4
    middle: NDArray[np.float64] = np.take(rising, range(cut, rising.shape[axis] - cut), axis=axis).mean(axis=axis)
    return middle


def _checked(part: pd.DataFrame) -> pd.DataFrame:
    """The rows of one domain, by policy."""
    domain = part["domain"].iloc[0]
    rows = _by_policy(part)
    if FLOOR not in rows.index[rows["kind"] == "policy"]:
        raise HarnessError(f"{domain} has no row of {FLOOR} to scale returns by; compare with it")
    if part.loc[part["kind"] == BOUND_KIND, "discounted_mean"].isna().all():
        raise HarnessError(f"{domain} has no upper bound to scale returns by; compare with 'mdp' where there is one")
    return rows


def _by_policy(part: pd.DataFrame) -> pd.DataFrame:
    rows = part.set_index("policy")
    names = rows.index[rows["kind"] == "policy"]
    if not names.is_unique:
        twice, domain = names[names.duplicated()][0], part["domain"].iloc[0]
        raise HarnessError(f"{domain} has two rows named {twice}; give them names of their own")
    return rows


def _scaled(rows: pd.DataFrame, mean: str, sem: str, resamples: int, draws: np.random.Generator) -> pd.DataFrame:
    """Scaled returns of a domain, a column a policy; the first row is the table's, the others are drawn."""
    means = _drawn(rows[rows["kind"] == "policy"], mean, sem, resamples, draws)
    bound = float(rows.loc[rows["kind"] == BOUND_KIND, mean].astype(float).min())
    return means.sub(means[FLOOR], axis=0).div(bound - means[FLOOR], axis=0)


def _drawn(played: pd.DataFrame, mean: str, sem: str, resamples: int, draws: np.random.Generator) -> pd.DataFrame:
    """Mean returns of a domain, a column a policy; the first row is the table's, the others are drawn."""
    noise = draws.standard_normal((1 + resamples, len(played)))
    noise[0] = 0
    values = played[mean].to_numpy(float) + played[sem].to_numpy(float) * noise
    return pd.DataFrame(values, columns=played.index.tolist())


def _interval(name: str, values: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """The columns of a summary from its (1 + resamples, policies) values."""
    low, high = np.quantile(values[1:], (0.025, 0.975), axis=0)
    return {name: values[0], f"{name}_low": low, f"{name}_high": high}
