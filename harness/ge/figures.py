"""Learning curves of an evolution."""

from __future__ import annotations

from typing import cast

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from harness.ge.results import quartiles
from harness.play.evaluation import Z95
from harness.show.drawing import LINE, blank, legend, plain


def run_figure(history: pd.DataFrame, axes: Axes | None = None) -> Figure:
    """One run: what selection saw of the best, and its score on fresh episodes with the 95 % interval."""
    axes = axes or blank(6, 4).subplots()
    x, middle, half = history["generation"], history["test"], Z95 * history["test_sem"]
    axes.plot(x, history["best"], color="0.7", linewidth=1, label="fitness of the best (what selection sees)")
    axes.fill_between(x, middle - half, middle + half, color=LINE, alpha=0.25, linewidth=0)
    axes.plot(x, middle, color=LINE, label="the best on fresh episodes, 95 % interval")
    return _finished(axes, float(middle.min()))


def runs_figure(history: pd.DataFrame, axes: Axes | None = None) -> Figure:
    """Several runs, told apart by the column ``seed``: median and quartiles of the best on fresh episodes."""
    axes = axes or blank(6, 4).subplots()
    curve = quartiles(history, "test")
    axes.fill_between(curve.index, curve["q25"], curve["q75"], color=LINE, alpha=0.25, linewidth=0)
    axes.plot(curve.index, curve["q50"], color=LINE, label=f"median and quartiles of {history['seed'].nunique()} runs")
    return _finished(axes, float(history["test"].min()))


def _finished(axes: Axes, lowest: float) -> Figure:
    axes.set(xlabel="generation", ylabel="undiscounted return within the horizon")
    axes.set_ylim(bottom=min(0.0, lowest))
    plain(axes)
    legend(axes)
    return cast(Figure, axes.figure)
