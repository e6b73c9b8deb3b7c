"""The table of published figures as text: for the terminal, for papers, for the documentation, for programs."""

from __future__ import annotations

import json
import math

import pandas as pd

from harness.score.published import RECALLED, RETURN
from harness.score.rendering import grid, outward, remark, rows
from harness.score.verdicts import ATTAINABLE, NOT_REPRODUCED, REPRODUCED, SURE, TELLING, UNATTAINABLE, UNDECIDED

LEGEND = f"""Discounted returns, mean ± standard error, unless the method's line says otherwise.
{REPRODUCED}: within {SURE:g} combined standard errors and the rounding of what was printed.
{UNDECIDED}: that too, but {SURE:g} errors are more than {TELLING:.0%} of the value, so that little can be told.
{NOT_REPRODUCED}: by how much ours is higher (+) or lower (-), with the combined error.
{ATTAINABLE}: the method is not here; its figure is not above the optimum, which lies between the bounds given.
{RECALLED}: from memory, read nowhere yet; quoted: read where somebody else quotes it."""


_JUDGED = ["verdict", "gap", "combined_error", "optimum_low", "optimum_high"]


def render(table: pd.DataFrame, format: str = "table") -> str:
    """The table of :func:`harness.literature` as ``harness literature`` prints it.

    Args:
        table: what :func:`harness.literature` returns.
        format: ``table``, ``markdown``, ``latex``, ``csv`` or ``json``, the last two with all columns.
    """
    if format == "csv":
        return table.to_csv(index=False)
    if format == "json":
        return json.dumps(rows(table), indent=2) + "\n"
    remarks = [LEGEND, "\n".join(notes(table)), tally(table)]
    return "\n\n".join([grid(shown(table), format), *(remark(each, format) for each in remarks)]) + "\n"


def shown(table: pd.DataFrame) -> pd.DataFrame:
    """The cells for people: the figure, ours, the verdict and the number of its reason in :func:`notes`."""
    numbers = _numbers(table)
    return pd.DataFrame(
        {
            "problem": table["problem"],
            "method": [_method(*pair) for pair in zip(table["method"], table["quantity"], strict=True)],
            "published": [_number(*pair) for pair in zip(table["printed"], table["error"], strict=True)],
            "in": [_source(*pair) for pair in zip(table["source"], table["seen"], strict=True)],
            "ours": [_ours(*each) for each in table[["ours", "ours_error", "printed"]].to_numpy()],
            "policy": table["policy"].where(table["ours"].notna(), ""),
            "verdict": [_verdict(*each) for each in table[_JUDGED].to_numpy()],
            "note": [str(numbers.get(why, "")) for why in table["why"]],
        }
    )


def notes(table: pd.DataFrame) -> list[str]:
    """What else is to be known of the figures, numbered: above all why they are beside nothing."""
    return [f"({number}) {why}" for why, number in _numbers(table).items()]


def _numbers(table: pd.DataFrame) -> dict[str, int]:
    return {why: number for number, why in enumerate(filter(None, table["why"].unique()), start=1)}


def _method(method: str, quantity: str) -> str:
    return method if quantity == RETURN else f"{method} ({quantity})"


def _source(source: str, seen: str) -> str:
    """The authors and the year; where a figure was not read in the source itself, that."""
    return f"{source.partition(',')[0]}{'' if seen == 'source' else f' ({seen})'}"


def _ours(ours: float, error: float, printed: str) -> str:
    """With the decimals of the published value."""
    return "" if pd.isna(ours) else _number(f"{ours:.{len(printed.partition('.')[2])}f}", error or math.nan)


def _number(text: str, error: float) -> str:
    return text if pd.isna(error) else f"{text} ± {error:.2f}"


def _verdict(verdict: str, gap: float, error: float, low: float, high: float) -> str:
    if verdict in (ATTAINABLE, UNATTAINABLE):
        return f"{verdict} ({' to '.join(outward(low, high))})"
    return verdict if pd.isna(gap) else f"{verdict} ({gap:+.2f} ± {error:.2f})"


def tally(table: pd.DataFrame) -> str:
    """How many figures got which verdict."""
    counts = table["verdict"].value_counts()
    return f"{len(table)} figures: {', '.join(f'{count} {verdict}' for verdict, count in counts.items())}."


def sources(table: pd.DataFrame) -> pd.DataFrame:
    """Where each figure was read, on which rules and budget, and how ours is run: for the documentation."""
    names = {"printed": "published", "source": "published in", "place": "read in", "run": "how ours is run"}
    cells = table[["problem", "method", "printed", "source", "place", "rules", "budget", "run"]]
    return cells.assign(run=table["run"].map(_command)).rename(columns=names)


def _command(text: str) -> str:
    return f"`{text}`" if text else ""
