"""How the report says things."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from tabulate import tabulate

from harness.score.verdicts import SURE


def parts(*paragraphs: str) -> str:
    """Paragraphs, tables and headings, one below the other."""
    return "\n\n".join(paragraphs)


def prose(text: str) -> str:
    """A paragraph on one line, however it is broken in the source."""
    return " ".join(text.split())


def table(headers: list[str], rows: list[list[str]]) -> str:
    """A table in Markdown."""
    return tabulate(rows, headers=headers, tablefmt="github", disable_numparse=True)


def plus_minus(mean: float, sem: float) -> str:
    """A mean and its standard error."""
    return f"{mean:.2f} ± {sem:.2f}"


def quartiles(values: Sequence[float], decimals: int = 2) -> str:
    """Median and quartiles of independent runs."""
    low, middle, high = (f"{x:.{decimals}f}" for x in np.quantile(values, [0.25, 0.5, 0.75]))
    return f"{middle} (quartiles {low} and {high})"


def verdict(ours: float, sem: float, published: float) -> str:
    """Whether a value of ours agrees with a published one that has no error of its own."""
    gap = ours - published
    if abs(gap) <= SURE * sem:
        return f"agrees ({gap:+.2f}, within {SURE:g} standard errors)"
    return f"differs ({gap:+.2f}" + (f", {abs(gap) / sem:.1f} standard errors)" if sem > 0 else ")")
