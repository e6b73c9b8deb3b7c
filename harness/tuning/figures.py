"""Pictures of sweeps and of runs, to be read on paper."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from harness.errors import HarnessError
from harness.play.evaluation import Z95
from harness.show.drawing import LINE, SECOND, blank, legend, plain

_NEAR = 0.15  # of the best return: what counts as near the top


def sweep_figure(table: pd.DataFrame, title: str = "") -> Figure:
    """Mean undiscounted return over the number swept, with its 95 % band, as a matplotlib figure.

    ``table`` is what :func:`harness.sweep` returns. Above, the whole range; below, what lies near the top, where the
    band can be seen. The highest point is named.

    Raises:
        HarnessError: it is another table, or has no rows.
    """
    if table.empty or not {"mean", "sem"} <= set(table.columns[2:]):
        raise HarnessError("this is no table of harness.sweep with a row at least")
    figure = blank(6.3, 5.4)
    whole, top = figure.subplots(2, 1, sharex=True)
    for axes in (whole, top):
        _sweep_line(axes, table)
        axes.set_ylabel("undiscounted return (reward)")
        plain(axes)
    best = table.iloc[int(table["mean"].argmax())]
    name, half = str(table.columns[1]), Z95 * float(best["sem"])
    low = max(float((table["mean"] - Z95 * table["sem"]).min()), best["mean"] - _NEAR * abs(best["mean"]))
    room = 0.12 * (best["mean"] - low) or 1.0
    top.set_ylim(low - room, best["mean"] + half + 2 * room)
    top.annotate(
        f"{best['mean']:.2f} ± {best['sem']:.2f} at {best[name]:g}",
        (best[name], best["mean"] + half),
        textcoords="offset points",
        xytext=(0, 5),
        ha="right" if best[name] > table[name].mean() else "left",
        color=SECOND,
        fontsize=9,
    )
    top.set_xlabel(f"{name} (no unit)")
    if name == "simulations":
        top.set_xscale("log")
        top.set_xlabel("simulations an action")
    figure.suptitle(title, fontsize=10)
    legend(whole, 2)
    return figure


def _sweep_line(axes: Axes, table: pd.DataFrame) -> None:
    x, mean, half = table.iloc[:, 1], table["mean"], Z95 * table["sem"]
    axes.fill_between(x, mean - half, mean + half, color=LINE, alpha=0.2, linewidth=0, label="95 % interval")
    axes.plot(x, mean, color=LINE, linewidth=1.4, label=f"mean of {int(table['episodes'].iloc[0]):,} episodes")
    k = int(mean.argmax())
    axes.plot([x.iloc[k]], [mean.iloc[k]], "o", color=SECOND, markersize=5)
    axes.margins(x=0.01)


def history_figure(history: pd.DataFrame, names: Sequence[str], measure: str) -> Figure:
    """Values and iterates of a tuning run over its iterations, as a matplotlib figure.

    ``history`` is that of :class:`~harness.tuning.outcome.Tuned`; ``names`` are the numbers tuned.
    """
    figure = blank(6.3, 5.2)
    above, below = figure.subplots(2, 1, sharex=True)
    label = "points played, 95 % interval" if history["sem"].any() else "points computed"
    above.errorbar(
        history["iteration"], history["value"], yerr=Z95 * history["sem"], fmt="o", color=LINE, markersize=2.5,
        elinewidth=0.6, label=label,
    )  # fmt: skip
    best = float(history["value"].max())
    low = best - _NEAR * abs(best)
    if (hidden := int((history["value"] < low).sum())) > 0:
        above.set_ylim(bottom=low)
        above.set_title(f"{hidden} of {len(history)} points lie below", fontsize=8, loc="right")
    unit = "discounted" if measure == "discounted" else "undiscounted"
    above.set_ylabel(f"{unit} return (reward)")
    legend(above)
    each = history.drop_duplicates("iteration")
    for name in names:
        below.plot(each["iteration"], each[f"theta_{name}"], marker=".", linewidth=1.2, label=name)
    below.set_ylabel("value of the parameter")
    below.set_xlabel("iteration")
    below.xaxis.set_major_locator(MaxNLocator(integer=True))
    legend(below, 5)
    for axes in (above, below):
        plain(axes)
    return figure
