"""The rows of a suite that cost little, as a list for ``harness check``."""

from __future__ import annotations

import dataclasses
import json

import pandas as pd

from harness.benchmark.budgets import Budget
from harness.benchmark.playing import ENGINE, SEED
from harness.play.evaluation import EPISODES
from harness.regression.rows import Row


def text(table: pd.DataFrame, budget: Budget) -> str:
    """``[[score]]`` tables of all but those that plan by simulation, to be put into a file of scores.

    ``harness check --update`` stores their scores there.
    """
    rows = table[(table["kind"] == "policy") & (table["episodes"] >= budget.episodes)]
    return "\n".join(
        _written(Row(domain, policy, EPISODES, SEED, int(horizon), ENGINE))
        for domain, policy, horizon in rows[["domain", "policy", "horizon"]].to_numpy()
    )


def _written(row: Row) -> str:
    given = {name: value for name, value in dataclasses.asdict(row).items() if value is not None and name != "how"}
    return "[[score]]\n" + "".join(f"{name} = {json.dumps(value)}\n" for name, value in given.items())
