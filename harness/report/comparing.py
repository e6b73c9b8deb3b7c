"""The section of a comparison table."""

from __future__ import annotations

import pandas as pd

from harness.errors import HarnessError
from harness.report import bars
from harness.report.inputs import Domains, Table
from harness.report.markup import caption_of, escape, note, plain_table, scrolled
from harness.report.replays import Wanted
from harness.score import rendering
from harness.score.aggregation import coverage

_KEYS = {  # what a column is sorted by
    "policy": "policy",
    "return": "mean",
    "discounted": "discounted_mean",
    "of optimum": "share_low",
    "published": "",
    "steps": "steps_mean",
    "success": "success_rate",
    "episodes": "episodes",
}


DOMAINS = "Over all domains"
"""The heading of the section of several domains together."""


def domains_body(table: Domains) -> str:
    """What every policy earns of what there is, over the domains that it plays."""
    try:
        cells = rendering.covered(coverage(table.frame))
    except HarnessError as reason:
        return note(f"No figures over the domains: {reason}.")
    body = plain_table("Share of the optimum", [str(name) for name in cells], cells.to_numpy().tolist())
    return body + note(rendering.COVERED)


def title(table: Table) -> str:
    """The section's heading."""
    return f"Comparison on {table.frame['domain'].iloc[0]}"


def body(table: Table) -> str:
    """The table, which the page's script makes sortable, and bars of it."""
    frame, cells = table.frame, rendering.shown(table.frame)
    head = "".join(f'<th scope="col"{_left(name)}>{escape(name)}</th>' for name in cells)
    rows = "".join(_row(frame.iloc[i], cells.iloc[i]) for i in range(len(frame)))
    caption = rendering.heading(frame)
    inside = f"{caption_of(caption)}<thead><tr>{head}</tr></thead><tbody>{rows}</tbody>"
    table_of_means = scrolled(caption, f'<table class="sortable">{inside}</table>')
    return table_of_means + bars.figures(frame) + _differences(frame) + note(rendering.footnote(frame))


def _differences(frame: pd.DataFrame) -> str:
    cells = rendering.differences(frame)
    if cells.empty:
        return ""
    return plain_table("Paired differences", [str(name) for name in cells], cells.values.tolist())


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
