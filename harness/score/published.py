"""Figures from the literature, from ``harness/data/literature.csv``, and those of them that may stand beside ours.

The file is plain CSV, which pandas reads; a line is a published figure. Its columns:

- ``problem``, ``rules``, ``method``, ``quantity``, ``value``, ``error`` (standard error), ``budget``: what was
  published.
- ``source``: the publication; ``place``: where in it, or in what, the figure was read; ``seen``: ``source`` (read in
  the publication itself), ``quoted`` (read where somebody quotes it) or ``recalled`` (from memory, read nowhere).
- ``differs``: why the rules are not those of a domain of ours; empty where nothing is known to differ.
- ``domain``: ours with the same rules; ``policy``: ours by the same method; ``ours``, ``ours_error``: what it gave, and
  ``run``: the command that gives it. Where ``ours`` is empty, it is the lower bound stored with the policy.
- ``note``: what else to know, above all why nothing was run.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import pandas as pd

from harness import registry

FILE = registry.DATA / "literature.csv"
RETURN = "discounted return"
"""The ``quantity`` that stands in tables of ours; there are others, such as thresholds."""
RECALLED = "recalled"
HORIZON = 50
"""Published returns are of episodes without an end. From so many steps on ours are as good as that; in fewer the task
is another one."""


class Published(NamedTuple):
    """A published mean discounted return, with its standard error where one was given."""

    method: str
    """As the source calls it."""
    policy: str
    """The first word of the policy of ours that it stands beside; empty where the method is not here."""
    value: float
    error: float | None
    source: str


@functools.cache
def _figures() -> pd.DataFrame:
    texts = dict.fromkeys(pd.read_csv(FILE, nrows=0).columns, str) | {
        "error": float,
        "ours": float,
        "ours_error": float,
    }
    read = pd.read_csv(FILE, dtype=texts, encoding="utf-8")
    words = [name for name, kind in texts.items() if kind is str]
    return read.fillna(dict.fromkeys(words, ""))


def figures() -> pd.DataFrame:
    """The file, a row a figure; ``value`` is text, with the decimals that were published."""
    return _figures().copy()


def on(domain: str) -> list[Published]:
    """The discounted returns that were published on the rules of a named domain of ours, and seen in print."""
    found = _figures()
    kept = (found["domain"] == domain) & (found["quantity"] == RETURN) & (found["differs"] == "")
    return [_published(row) for _, row in found[kept & (found["seen"] != RECALLED)].iterrows()]


def _published(row: pd.Series) -> Published:
    error = None if pd.isna(row["error"]) else float(row["error"])
    return Published(row["method"], _word(row["policy"]), float(row["value"]), error, row["source"])


def _word(policy: str) -> str:
    return policy.partition(":")[0]


def reference(domain: str, policy: str, horizon: int = HORIZON) -> Published | None:
    """The published figure for a policy string of ours on a domain, if there is one on the same rules."""
    return next((entry for entry in _within(domain, horizon) if entry.policy == _word(policy)), None)


def not_run_here(domain: str, policies: list[str], horizon: int = HORIZON) -> list[Published]:
    """Published figures on a domain for methods that are not among the policies shown."""
    shown = {_word(policy) for policy in policies}
    return [entry for entry in _within(domain, horizon) if entry.policy not in shown]


def _within(domain: str, horizon: int) -> list[Published]:
    return on(domain) if horizon >= HORIZON else []
