"""What the paper states: every number of it that can be stood beside one of ours, and where it stands there."""

from __future__ import annotations

from typing import NamedTuple

from harness.score import published

ROCKSAMPLE, BORDERCROSS = "rocksample-7x8", "bordercross-7x8"
SHAPINGS = ("none", "paper", "potential")

ACCURACY, BELIEF = "accuracy", "belief"
HEURISTICS = (ACCURACY, BELIEF)
SYMBOL = {ACCURACY: "λ", BELIEF: "γ"}
GRADIENT = {ACCURACY: "0.9310", BELIEF: "0.8439"}
"""Thresholds that gradient ascent found (section 5)."""
EVOLVED = {ACCURACY: "0.93", BELIEF: "0.74"}
"""Thresholds that evolution found (section 5)."""
START = {ACCURACY: 0.95, BELIEF: 0.92}
"""Where our ascents begin, on a slope; the paper does not say where its own did."""

STATES = 12_544
RANDOM_SHARE = 12.8
"""Per cent of the maximum reward that random rollouts earn (section 5)."""
SARSOP_SHARE = 30
"""Per cent of the maximum reward that the paper concludes SARSOP gets at most (section 5)."""


class Table1Row(NamedTuple):
    """A method of Table 1, its published discounted return (Silver and Veness), and the policy of ours beside it."""

    method: str
    value: float
    policy: str


def table_1() -> tuple[Table1Row, ...]:
    """The two methods of Table 1, from ``harness/data/literature.csv``."""
    named = {entry.policy: entry.value for entry in published.on(ROCKSAMPLE)}
    return Table1Row("Rollout", named["rollout"], "rollout:100"), Table1Row("SARSOP", named["sarsop"], "sarsop")


class Setting(NamedTuple):
    """A row of Table 2 or 3: the paper's name and value, and the name of ours."""

    name: str
    value: str
    ours: str


TABLE_2 = (
    Setting("Individuals in population", "250", "population"),
    Setting("Episodes", "100", "episodes"),
    Setting("Generations", "500 / 399", "generations"),
    Setting("Max steps", "50", "horizon"),
    Setting("Penalty for long codes", "max([0,length - 50])*0.1", "penalty"),
)
TABLE_3 = (
    Setting("Episodes", "10000", "episodes"),
    Setting("Error Tolerance", "0.001", "tolerance"),
    Setting("γ (momentum)", "0.2", "momentum"),
    Setting("ε (forward difference; the symbol is lost in print)", "0.01", "epsilon"),
    Setting("α0", "0.05", "rate"),
    Setting("α_{t+1}", "α_t exp(−t/20)", "decay"),
)
