"""Dual numbers, the gates that make them, and the rows in which soft policies write down what they may do.

A dual number is a row of 1 + d numbers: a value, and its derivatives by d constants. A gate stands for the comparison
x > c: it is open with probability sigmoid((x − c) / τ), which is smooth in c and becomes the comparison as τ → 0.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.model.tables import inlined

LEAST = 1e-16
"""Probability of a path below which it is dropped: what rounding loses anyhow."""


class Rows(NamedTuple):
    """What the situations of a layer may do; B rows."""

    source: NDArray[np.int64]
    """(B,) the situation."""
    action: NDArray[np.int32]
    """(B,)"""
    memory: NDArray[np.int64]
    """(B, M) what is remembered then."""
    mass: NDArray[np.float64]
    """(B, 1 + d) dual: how likely the situation is, and that it does this."""


def room(count: int, memory: int, width: int) -> Rows:
    """Rows to write to; ``width``: 1 + d."""
    return Rows(
        np.empty(count, dtype=np.int64),
        np.empty(count, dtype=np.int32),
        np.empty((count, memory), dtype=np.int64),
        np.empty((count, width)),
    )


def written(rows: Rows, count: int) -> Rows:
    """The first rows."""
    return Rows(rows.source[:count], rows.action[:count], rows.memory[:count], rows.mass[:count])


@inlined
def gate(excess: float, temperature: float) -> tuple[float, float]:
    """Probability that a gate is open, and its derivative by ``excess``; the probability that it is not is that of
    ``-excess``, without cancellation."""
    e = math.exp(-abs(excess) / temperature)
    slope = e / (1.0 + e) ** 2 / temperature
    return (1.0 if excess >= 0.0 else e) / (1.0 + e), slope


@inlined
def weigh(
    out: NDArray[np.float64], mass: NDArray[np.float64], probability: float, derivative: float, constant: int
) -> None:
    """``out`` = ``mass`` times a probability that depends on one constant; ``out`` may be ``mass`` itself."""
    before = mass[0]
    for c in range(len(mass)):
        out[c] = mass[c] * probability
    out[1 + constant] += before * derivative


@inlined
def times(out: NDArray[np.float64], a: NDArray[np.float64], b: NDArray[np.float64]) -> None:
    """``out`` = ``a`` · ``b``; ``out`` may be either."""
    x, y = a[0], b[0]
    for c in range(1, len(a)):
        out[c] = x * b[c] + y * a[c]
    out[0] = x * y


@inlined
def ratio(out: NDArray[np.float64], a: NDArray[np.float64], b: NDArray[np.float64]) -> None:
    """``out`` = ``a`` / ``b``; ``out`` may be either."""
    quotient, y = a[0] / b[0], b[0]
    for c in range(1, len(a)):
        out[c] = (a[c] - quotient * b[c]) / y
    out[0] = quotient


@inlined
def emit(
    rows: Rows, first: int, count: int, e: int, action: int, memory: NDArray[np.int64], mass: NDArray[np.float64]
) -> int:
    """Write a row, or add to one of those from ``first`` on that does the same; how many there are then."""
    source, actions, memories, masses = rows.source, rows.action, rows.memory, rows.mass
    if mass[0] < LEAST:
        return count
    at = first
    while at < count and not _same(actions[at], memories[at], action, memory):
        at += 1
    if at < count:
        for c in range(len(mass)):
            masses[at, c] += mass[c]
        return count
    source[count], actions[count] = e, action
    for c in range(len(memory)):
        memories[count, c] = memory[c]
    for c in range(len(mass)):
        masses[count, c] = mass[c]
    return count + 1


@inlined
def _same(action: int, memory: NDArray[np.int64], other: int, others: NDArray[np.int64]) -> bool:
    same = action == other
    for c in range(len(memory)):
        if memory[c] != others[c]:
            same = False
    return same
