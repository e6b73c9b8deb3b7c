"""What all figures share. They are to be read on paper; no window is opened: Agg draws them.

Bands and bars are 95 % intervals of a mean throughout; over independent runs, the quartiles between the runs. The ± of
tables and titles is one standard error. What is called ``plot`` or ``…_figure`` returns a figure; what is called
``draw_…`` draws on axes, those given or new ones, and returns them.
"""

from __future__ import annotations

import base64
import io
from pathlib import Path
from typing import Any, Literal

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from harness import files
from harness.errors import HarnessError

LINE, SECOND, THIRD = "#1f4e79", "#a65000", "#3c7a3c"
"""Colours that differ in print too, by their darkness."""

_DPI = 200
_UNDATED: dict[str, dict[str, None]] = {"png": {}, "pdf": {"CreationDate": None}, "svg": {"Date": None}}


class Picture(Figure):
    """A figure that a notebook shows with a text in place of it, for who cannot see it."""

    def _repr_mimebundle_(self, **_: Any) -> tuple[dict[str, str], dict[str, dict[str, str]]]:
        image = io.BytesIO()
        self.savefig(image, format="png", bbox_inches="tight")
        return {"image/png": base64.b64encode(image.getvalue()).decode()}, {"image/png": {"alt": described(self)}}


def blank(width: float, height: float) -> Picture:
    """An empty figure of so many inches."""
    figure = Picture(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def axes_or_new(axes: Axes | None, width: float, height: float) -> Axes:
    """The axes given, or those of a new figure of so many inches, which a notebook shows by itself."""
    if axes is not None:
        return axes
    from matplotlib import pyplot as plt

    return plt.figure(figsize=(width, height), layout="constrained", FigureClass=Picture).subplots()


def plain(axes: Axes, grid: Literal["x", "y"] = "y") -> None:
    """Leave out what carries no information; ``grid`` is the axis of the values."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(axis=grid, color="0.9", linewidth=0.6)
    axes.set_axisbelow(True)


def legend(axes: Axes, columns: int = 1) -> None:
    """A legend above the axes, where it lies on no data."""
    axes.legend(frameon=False, fontsize=8, ncols=columns, loc="lower left", bbox_to_anchor=(0, 1), borderaxespad=0.2)


def cells(axes: Axes, columns: int, rows: int, *, upward: bool) -> None:
    """Set up axes as a grid of cells, numbered from 1, each a unit wide; rows grow upward or downward."""
    axes.set_xticks(range(1, columns + 1))
    axes.set_yticks(range(1, rows + 1))
    ends = (0.5, rows + 0.5)
    axes.set(xlim=(0.5, columns + 0.5), ylim=ends if upward else ends[::-1], aspect="equal")
    axes.set(xlabel="column", ylabel="row")
    axes.tick_params(which="both", length=0, labelsize=8)


def described(figure: Figure) -> str:
    """What a figure shows, in words: its titles, what its axes are, what is drawn on them."""
    title = figure.get_suptitle()
    parts = [f"Figure: {title}" if title else "Figure", *(_panel(axes) for axes in figure.axes)]
    return ". ".join(part for part in parts if part) + "."


def _panel(axes: Axes) -> str:
    labels = dict.fromkeys(axes.get_legend_handles_labels()[1])
    over = " over ".join(label for label in (axes.get_ylabel(), axes.get_xlabel()) if label)
    shown = f"with {', '.join(labels)}" if labels else ""
    rows = ", ".join(text for label in axes.get_yticklabels() if (text := label.get_text()) and text[-1].isalpha())
    titles = [axes.get_title(side) for side in ("left", "center", "right")]
    return "; ".join(text for text in (*titles, over, rows, shown) if text)


def check_ending(path: Path) -> str:
    """The format that a file's name asks for.

    Raises:
        HarnessError: it is none of PNG, PDF and SVG.
    """
    kind = path.suffix.lower().removeprefix(".")
    if kind not in _UNDATED:
        raise HarnessError(f"{path}: the name of a figure's file must end in .png, .pdf or .svg")
    return kind


def save(figure: Figure, path: Path) -> None:
    """Write a figure as PNG, PDF or SVG, by the file's ending; the same figure gives the same file.

    Raises:
        HarnessError: the ending is another, or the file cannot be written.
    """
    kind = check_ending(path)
    # Fonts in a PDF that publishers take; names in an SVG that are the same every time.
    with files.replacing(path) as file, rc_context({"pdf.fonttype": 42, "svg.hashsalt": "harness"}):
        figure.savefig(file, format=kind, dpi=_DPI, metadata=_UNDATED[kind])
