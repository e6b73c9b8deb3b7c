"""What all figures share. They are to be read on paper; no window is opened: Agg draws them."""

from __future__ import annotations

from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from harness import files

LINE, SECOND, THIRD = "#1f4e79", "#a65000", "#3c7a3c"
"""Colours that differ in print too, by their darkness."""

_DPI = 200


def blank(width: float, height: float) -> Figure:
    """An empty figure of so many inches."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def plain(axes: Axes) -> None:
    """Leave out what carries no information."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(axis="y", color="0.9", linewidth=0.6)
    axes.set_axisbelow(True)


def save(figure: Figure, path: Path) -> None:
    """Write a figure as PNG.

    Raises:
        HarnessError: the file cannot be written.
    """
    with files.replacing(path) as file:
        figure.savefig(file, format="png", dpi=_DPI)
