"""The section of a comparison table."""

from __future__ import annotations

import pandas as pd

from harness.report.inputs import Table
from harness.report.markup import caption_of, escape, note, scrolled
from harness.report.replays import Wanted
from harness.score import comparison

_KEYS = {  # what a column is sorted by
    "policy": "policy",
    "return": "mean",
    "discounted": "discounted_mean",
    "published": "",
    "steps": "steps_mean",
    "success": "success_rate",
    "episodes": "episodes",
}


def title(table: Table) -> str:
    """The section's heading."""
    return f"Comparison on {table.frame['domain'].iloc[0]}"


def body(table: Table) -> str:
    """The table, which the page's script makes sortable."""
    frame, cells = table.frame, comparison.shown(table.frame)
    head = "".join(f'<th scope="col"{_left(name)}>{escape(name)}</th>' for name in cells)
    rows = "".join(_row(frame.iloc[i], cells.iloc[i]) for i in range(len(frame)))
    caption = comparison.heading(frame)
    inside = f"{caption_of(caption)}<thead><tr>{head}</tr></thead><tbody>{rows}</tbody>"
    return scrolled(caption, f'<table class="sortable">{inside}</table>') + note(comparison.footnote(frame))


def _left(name: object) -> str:
    return ' class="text"' if name == "policy" else ""


def _row(row: pd.Series, cells: pd.Series) -> str:
    kind = ' class="bound"' if row["kind"] != "policy" else ""
    line = ""
    for name, text in cells.items():
        key = row[_KEYS[str(name)]] if _KEYS[str(name)] else text.partition(" ")[0]
        sort = "" if pd.isna(key) or key == "" else f' data-key="{escape(key)}"'
        tag = 'th scope="row" class="text"' if name == "policy" else "td"
        line += f"<{tag}{sort}>{escape(text)}</{tag.split()[0]}>"
    return f"<tr{kind}>{line}</tr>"


def wanted(table: Table, seed: int | None) -> list[Wanted]:
    """Its policies, in the episodes that the table is of, or in those of another seed."""
    frame = table.frame[table.frame["kind"] == "policy"]
    return [
        Wanted(
            label=str(row["policy"]),
            domain=str(row["domain"]),
            seed=int(row["seed"]) if seed is None else seed,
            horizon=int(row["horizon"]),
            spec=str(row["policy"]),
            version=int(row["domain_version"]),
        )
        for _, row in frame.iterrows()
    ]
