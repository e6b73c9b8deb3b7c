"""What the page draws as charts: the numbers, which are in a table below each chart too."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from harness.play.evaluation import Z95
from harness.report.markup import data, details, escape, number, plain_table

RETURN = "undiscounted return (reward)"
_NEAR = 0.15  # of the best return: what counts as near the top
_FAR = 3.0  # spans of the upper nine tenths below the highest value: what would flatten the rest of a chart


@dataclass(frozen=True)
class Series:
    """Values over the chart's x, with a band where there is one."""

    name: str
    y: pd.Series
    low: pd.Series | None = None
    high: pd.Series | None = None
    points: bool = False
    """Points with bars instead of a line with a band."""

    @classmethod
    def with_error(cls, name: str, y: pd.Series, sem: pd.Series, *, points: bool = False) -> Series:
        """With the 95 % interval of a mean."""
        return cls(name, y, y - Z95 * sem, y + Z95 * sem, points)


@dataclass(frozen=True)
class Chart:
    """One chart."""

    title: str
    x_label: str
    y_label: str
    x: pd.Series
    series: Sequence[Series]
    bottom: float | None = None
    """Where the y axis begins; what lies below is not drawn."""
    whole: bool = False
    """Whether x counts something."""
    best: bool = False
    """Whether the highest point of the first series is marked."""


def figure(chart: Chart) -> str:
    """The chart as HTML: its numbers for the script that draws it, and as a table."""
    hidden = 0
    if chart.bottom is not None:
        hidden = sum(int((series.y < chart.bottom).sum()) for series in chart.series)
    below = f"<p>{hidden} of {len(chart.x) * len(chart.series)} values lie below.</p>" if hidden else ""
    return (
        f'<figure class="chart"><figcaption>{escape(chart.title)}</figcaption>{data(_record(chart))}{below}'
        f"{details('Numbers of this chart', _table(chart))}</figure>"
    )


def _record(chart: Chart) -> dict[str, Any]:
    return {
        "title": chart.title,
        "x": {"label": chart.x_label, "values": _values(chart.x), "whole": chart.whole},
        "y": {"label": chart.y_label, "bottom": chart.bottom},
        "best": chart.best,
        "series": [
            {
                "name": each.name,
                "points": each.points,
                "y": _values(each.y),
                "low": None if each.low is None else _values(each.low),
                "high": None if each.high is None else _values(each.high),
            }
            for each in chart.series
        ],
    }


def _values(column: pd.Series) -> list[float | None]:
    """Six significant digits are more than a chart shows; None where there is no number."""
    return [float(f"{x:.6g}") if np.isfinite(x) else None for x in column.astype(float)]


def _table(chart: Chart) -> str:
    head, columns = [chart.x_label], [chart.x]
    for each in chart.series:
        head.append(each.name)
        columns.append(each.y)
        if each.low is not None and each.high is not None:
            head += ["from", "to"]
            columns += [each.low, each.high]
    rows = [[number(float(x)) for x in row] for row in zip(*columns, strict=True)]
    return plain_table(f"{chart.title}: {chart.y_label}", head, rows)


def near_the_top(values: pd.Series) -> float | None:
    """Where an axis begins that shows what is close to the best; None where all of it is."""
    best = float(values.max())
    bottom = best - _NEAR * abs(best)
    return bottom if float(values.min()) < bottom else None


def without_outliers(values: pd.Series) -> float | None:
    """Where an axis begins that the lowest values would flatten; None where they would not."""
    finite = values[np.isfinite(values)]
    if finite.empty:
        return None
    best, low = float(finite.max()), float(finite.quantile(0.1))
    return low - 0.5 * (best - low) if best > low and float(finite.min()) < best - _FAR * (best - low) else None
