"""The front of return against length: what earns more than all shorter programs that a run has kept."""

from __future__ import annotations

import pandas as pd

COLUMNS = {
    "length": "statements",
    "validation": "mean return in the comparison of the finalists, which no generation has seen",
    "validation_sem": "its standard error; 0 where it is exact",
    "program": "its text",
}
"""Columns of a front."""


def front(judged: pd.DataFrame) -> pd.DataFrame:
    """The rows of programs that earn more than all shorter ones, the shortest first, with :data:`COLUMNS`.

    ``judged``: one row a program, of which those columns are looked at; of programs of one length the best stands for
    all.
    """
    ordered = judged.sort_values(["length", "validation"], ascending=[True, False], kind="stable")
    best = ordered["validation"].cummax()
    kept = ordered[(best > best.shift()) | best.shift().isna()]
    return kept[list(COLUMNS)].reset_index(drop=True)
