"""Pictures of sweeps and of runs, to be read on paper. No window is opened: figures are drawn by Agg."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from harness import archive
from harness.errors import HarnessError
from harness.evaluation import Z95

_LINE, _SECOND = "#1f4e79", "#a65000"
_DPI = 200


def sweep_figure(table: pd.DataFrame, title: str = "") -> Figure:
    """Mean undiscounted return over the number swept, with its 95 % band, as a matplotlib figure.

    ``table`` is what :func:`harness.sweep` returns. The highest point is named.
    """
    figure = _figure(6.3, 3.9)
    axes = figure.add_subplot()
    name = str(table.columns[1])
    x, mean, half = table[name], table["mean"], Z95 * table["sem"]
    axes.fill_between(x, mean - half, mean + half, color=_LINE, alpha=0.2, linewidth=0, label="95 % interval")
    axes.plot(x, mean, color=_LINE, linewidth=1.4, label=f"mean of {int(table['episodes'].iloc[0]):,} episodes")
    best = table.iloc[int(mean.argmax())]
    axes.plot([best[name]], [best["mean"]], "o", color=_SECOND, markersize=5)
    axes.annotate(
        f"{best['mean']:.2f} ± {best['sem']:.2f} at {best[name]:g}",
        (best[name], best["mean"]),
        textcoords="offset points",
        xytext=(0, 9),
        ha="right" if best[name] > x.mean() else "left",
        color=_SECOND,
    )
    axes.margins(x=0.01, y=0.15)
    axes.set_xlabel(f"{name} (probability)")
    axes.set_ylabel("undiscounted return (reward)")
    axes.set_title(title, fontsize=10)
    axes.legend(frameon=False, loc="best", fontsize=8)
    _plain(axes)
    return figure


def history_figure(history: pd.DataFrame, names: Sequence[str], measure: str) -> Figure:
    """Values and iterates of a tuning run over its iterations, as a matplotlib figure.

    ``history`` is that of :class:`~harness.tuning.run.Tuned`; ``names`` are the numbers tuned.
    """
    figure = _figure(6.3, 5.2)
    above, below = figure.subplots(2, 1, sharex=True)
    above.errorbar(
        history["iteration"], history["value"], yerr=Z95 * history["sem"], fmt="o", color=_LINE, markersize=2.5,
        elinewidth=0.6, label="points played, 95 % interval",
    )  # fmt: skip
    unit = "discounted" if measure == "discounted" else "undiscounted"
    above.set_ylabel(f"{unit} return (reward)")
    above.legend(frameon=False, loc="best", fontsize=8)
    each = history.drop_duplicates("iteration")
    for name in names:
        below.plot(each["iteration"], each[f"theta_{name}"], marker=".", linewidth=1.2, label=name)
    below.set_ylabel("value of the parameter")
    below.set_xlabel("iteration")
    below.xaxis.set_major_locator(MaxNLocator(integer=True))
    below.legend(frameon=False, loc="best", fontsize=8)
    for axes in (above, below):
        _plain(axes)
    return figure


def save(figure: Figure, path: Path) -> None:
    """Write a figure as PNG.

    Raises:
        HarnessError: the file cannot be written.
    """
    try:
        archive.replace(path, lambda file: figure.savefig(file, format="png", dpi=_DPI))
    except OSError as error:
        raise HarnessError(f"cannot write {path}: {error.strerror}") from None


def _figure(width: float, height: float) -> Figure:
    figure = Figure(figsize=(width, height), layout="constrained")  # inches
    FigureCanvasAgg(figure)
    return figure


def _plain(axes: Axes) -> None:
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(axis="y", color="0.9", linewidth=0.6)
    axes.set_axisbelow(True)
