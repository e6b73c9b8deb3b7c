"""The paper's figures, drawn from tables and layouts; all to be read in black and white too."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from harness.ge.results import QUARTILES
from harness.model.domain import Domain
from harness.play.evaluation import Z95
from harness.reproduction import paper
from harness.show.drawing import LINE, SECOND, THIRD, blank, cells, legend, plain

_RETURN = "undiscounted return (reward)"
_STYLES = ((LINE, "-"), (SECOND, "--"), (THIRD, "-."))


def layout(domain: Domain) -> Figure:
    """Figures 1 and 2: the grid with rocks or wall, start cells, and the exit column."""
    plan = domain.layout
    columns, rows, up = plan["exit_column"], plan["rows"], plan["rows_grow"] == "up"
    figure = blank(0.55 * columns + 0.7, 0.55 * rows + 0.5)
    axes = figure.subplots()
    for x in range(1, columns + 1):
        for y in range(1, rows + 1):
            colour = {plan["exit_column"]: "0.85", plan.get("wall_column"): "0.35"}.get(x, "white")
            axes.add_patch(Rectangle((x - 0.5, y - 0.5), 1, 1, facecolor=colour, edgecolor="0.5", linewidth=0.8))
    for (x, y), mark in _marks(domain).items():
        axes.text(x, y, mark, ha="center", va="center", fontsize=11, color="white" if mark == "X" else "black")
    cells(axes, columns, rows, upward=up)
    axes.spines[:].set_visible(False)
    return figure


def _marks(domain: Domain) -> dict[tuple[int, int], str]:
    """What stands in a cell (column, row): rocks by number, R for the robot; robots as R1 and R2, X for the wall."""
    plan = domain.layout
    if plan["kind"] == "rocksample":
        rocks = {(x, y): f"{i + 1}" for i, (x, y) in enumerate(plan["rocks"])}
        return {**rocks, tuple(plan["start"]): "R", (plan["exit_column"], (plan["rows"] + 1) // 2): "exit"}
    marks = {(plan["wall_column"], y): "X" for y in range(1, plan["rows"] + 1)}
    for robot, (row, column) in enumerate(_starts(domain), 1):
        marks[column, row] = f"R{robot}"
    return {**marks, (plan["exit_column"], (plan["rows"] + 1) // 2): "exit"}


def _starts(domain: Domain) -> list[tuple[int, int]]:
    """(row, column) of both robots in the one initial state."""
    from harness.engine.rng import ENGINE, uniforms
    from harness.engine.tables import TablesEngine

    engine = TablesEngine(domain, 1, False)
    engine.reset(uniforms(0, ENGINE, 0, 0, 1))
    values = dict(zip(domain.visible_names, domain.visible_values[engine.visible[0]].tolist(), strict=True))
    return [(values[f"row{robot}"], values[f"column{robot}"]) for robot in (1, 2)]


def learning(full: pd.DataFrame, thresholds: pd.DataFrame) -> Figure:
    """Figure 3. ``full``: histories of the full search; ``thresholds``: of the parametrized policies."""
    figure = blank(6.3, 3.8)
    axes = figure.subplots()
    _curve(axes, full, "test", "full policy search", _STYLES[0])
    for word, style in zip(paper.HEURISTICS, _STYLES[1:], strict=True):
        _curve(axes, thresholds[thresholds["heuristic"] == word], "test", f"{word}-based policy", style)
    axes.set(xlabel="generation", ylabel=_RETURN)
    figure.suptitle(_runs(full) + " of the best on fresh episodes: median, quartiles shaded", fontsize=9)
    _finish(axes)
    return figure


def crossing(histories: pd.DataFrame) -> Figure:
    """Figure 6. Left what the search sees, right the true team return of the same programs."""
    figure = blank(6.3, 3.6)
    panels = figure.subplots(1, 2)
    labels = ("fitness (reward with shaping)", "team return (reward)")
    for axes, column, label in zip(panels, ("best", "test"), labels, strict=True):
        for shaping, style in zip(paper.SHAPINGS, _STYLES, strict=True):
            name = "no shaping" if shaping == "none" else f"shaping: {shaping}"
            _curve(axes, histories[histories["shaping"] == shaping], column, name, style)
        axes.set(xlabel="generation", ylabel=label)
        plain(axes)
        axes.margins(x=0.01)
    figure.legend(
        *panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False, fontsize=8
    )
    figure.suptitle(_runs(histories) + ": median, quartiles shaded", fontsize=9)
    return figure


def sweeps(table: pd.DataFrame, ascents: pd.DataFrame) -> Figure:
    """Figure 5. Return over each threshold with its 95 % band; optimum, ascent and published thresholds marked."""
    figure = blank(6.3, 6.0)
    for row, word in enumerate(paper.HEURISTICS):
        one = table[table["heuristic"] == word]
        x, mean, half = one["threshold"], one["mean"], Z95 * one["sem"]
        axes = figure.add_subplot(2, 1, row + 1)
        axes.fill_between(x, mean - half, mean + half, color=LINE, alpha=0.25, linewidth=0, label="95 % interval")
        axes.plot(x, mean, color=LINE, linewidth=1.4, label=f"mean of {int(one['episodes'].iloc[0]):,} episodes")
        top = best_stretch(one)
        axes.plot(top, [mean.max()] * 2, "-o", color=SECOND, linewidth=2.5, label=f"highest: {span(*top)}")
        ours = ascents[ascents["heuristic"] == word].iloc[0]
        label = f"our ascent: {ours['threshold']:.4f}"
        axes.errorbar(ours["threshold"], ours["mean"], Z95 * ours["sem"], fmt="D", color=THIRD, capsize=3, label=label)
        for value, style, what in ((paper.GRADIENT[word], ":", "ascent"), (paper.EVOLVED[word], "--", "evolution")):
            axes.axvline(float(value), color="0.35", linestyle=style, linewidth=1, label=f"the paper's {what}: {value}")
        axes.set(xlabel=f"{word} threshold {paper.SYMBOL[word]} (a probability)", ylabel=_RETURN)
        _finish(axes)
    return figure


def best_stretch(sweep: pd.DataFrame) -> tuple[float, float]:
    """First and last threshold of a sweep with its highest return: equal means are of equal episodes."""
    top = sweep.loc[sweep["mean"] == sweep["mean"].max(), "threshold"]
    return float(top.min()), float(top.max())


def span(low: float, high: float) -> str:
    """A range of numbers, or the one that it consists of."""
    return f"{low:g}" if low == high else f"{low:g} to {high:g}"


def _curve(axes: Axes, histories: pd.DataFrame, column: str, label: str, style: tuple[str, str]) -> None:
    quantiles: Any = histories.groupby("generation")[column].quantile(np.array(QUARTILES)).unstack()
    low, middle, high = (quantiles[q] for q in QUARTILES)
    axes.fill_between(quantiles.index, low, high, color=style[0], alpha=0.2, linewidth=0)
    axes.plot(quantiles.index, middle, color=style[0], linestyle=style[1], linewidth=1.4, label=label)


def _runs(histories: pd.DataFrame) -> str:
    return f"{histories['seed'].nunique()} runs"


def _finish(axes: Axes) -> None:
    plain(axes)
    axes.margins(x=0.01)
    legend(axes, 3)
