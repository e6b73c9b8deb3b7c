"""A model as its file has it: variables of a state, of an action and of a reading, and functions of them.

A ``.pomdp`` file has one variable of each kind; a POMDPX file may have several, of which some are fully observed.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from harness.errors import HarnessError
from harness.formats.rules import Function, Points

ROUNDING = 1e-4
"""How far a distribution in a file may be from 1: files are printed with few digits."""
EXACT = 1e-10
"""Up to here it is taken as it is, to the last bit; beyond, it is scaled to 1."""


@dataclass(frozen=True)
class Variable:
    """A variable and its values."""

    name: str
    values: tuple[str, ...]
    visible: bool = False
    """Of a state's: whether the agent always knows it (``fullyObs``)."""

    def __len__(self) -> int:
        """Number of values."""
        return len(self.values)


@dataclass(frozen=True)
class Columns:
    """Where a point has which variable: actions, state before, state after, readings."""

    actions: int
    states: int
    readings: int

    def action(self, i: int) -> int:
        """Of the i-th action variable."""
        return i

    def before(self, j: int) -> int:
        """Of the j-th state variable before the step."""
        return self.actions + j

    def after(self, j: int) -> int:
        """Of the j-th state variable after the step."""
        return self.actions + self.states + j

    def reading(self, i: int) -> int:
        """Of the i-th variable that is read."""
        return self.actions + 2 * self.states + i

    @property
    def count(self) -> int:
        """All of them."""
        return self.actions + 2 * self.states + self.readings


@dataclass(frozen=True, eq=False)
class Network:
    """A model file's contents."""

    file: str
    discount: float
    actions: tuple[Variable, ...]
    states: tuple[Variable, ...]
    readings: tuple[Variable, ...]
    start: tuple[Function, ...]
    """Distribution of each state variable before the first step."""
    moves: tuple[Function, ...]
    """Distribution of each state variable after a step."""
    seen: tuple[Function, ...]
    """Distribution of each variable that is read after a step."""
    paid: tuple[Function, ...]
    """Functions whose sum is the reward."""
    line_of: Callable[[int], int] = int
    """Line in the file for a number in :attr:`Function.lines <harness.formats.rules.Function.lines>`."""
    scaled: list[int] = field(default_factory=lambda: [0], compare=False)
    """How many distributions did not sum to 1 exactly and were scaled: one number, which grows as they are used."""

    @property
    def columns(self) -> Columns:
        """The columns of points."""
        return Columns(len(self.actions), len(self.states), len(self.readings))

    @property
    def visible(self) -> list[int]:
        """Which state variables the agent always knows."""
        return [j for j, variable in enumerate(self.states) if variable.visible]

    @property
    def hidden(self) -> list[int]:
        """Which it does not."""
        return [j for j, variable in enumerate(self.states) if not variable.visible]

    def names(self, column: int) -> Variable:
        """The variable of a column."""
        return [*self.actions, *self.states, *self.states, *self.readings][column]

    def distributed(
        self, functions: Sequence[Function], points: Points
    ) -> tuple[Points, NDArray[np.int64], NDArray[np.float64]]:
        """All that some variables can be at the points, one after the other: points, of which each, and its weight.

        Raises:
            HarnessError: a function is no distribution at a point.
        """
        origin, weight = np.arange(len(points)), np.ones(len(points))
        for function in ordered(self, functions):
            point, value, share = self._checked(function, points)
            points, origin, weight = points[point], origin[point], weight[point] * share
            points[:, function.columns[-1]] = value
        return points, origin, weight

    def place(self, line: int) -> str:
        """File and line, as messages say them; arrays have no lines."""
        number = self.line_of(line)
        return f"{self.file}, line {number}" if number else self.file

    def _checked(
        self, function: Function, points: Points
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
        point, value, share = function.spread(points)
        total = np.bincount(point, share, minlength=len(points))
        lowest = np.full(len(points), 0.0)
        np.minimum.at(lowest, point, share)
        bad = ~(np.abs(total - 1) <= ROUNDING) | (lowest < 0)
        if bad.any():
            raise self._no_distribution(function, points[bad.argmax()], total[bad.argmax()])
        off = np.abs(total - 1) > EXACT
        if off.any():
            self.scaled[0] += int(off.sum())
            share = np.where(off[point], share / total[point], share)
        return point, value, share

    def _no_distribution(self, function: Function, point: NDArray[np.int64], total: float) -> HarnessError:
        there = point[None].repeat(function.sizes[-1], axis=0)
        there[:, function.columns[-1]] = np.arange(function.sizes[-1])
        line = max(function.line(each[None]) for each in there)
        given = [f"{self.names(c).name} {self.names(c).values[point[c]]}" for c in function.columns[:-1]]
        where = f" at {', '.join(given)}" if given else ""
        name, wrong = self.names(int(function.columns[-1])).name, f"sum to {total:.10g}, not to 1"
        if abs(total - 1) <= ROUNDING:
            wrong = "have a negative one among them"
        return HarnessError(f"{self.place(line)}: the probabilities of {name}{where} {wrong}; mend or add them")


def ordered(network: Network, functions: Sequence[Function]) -> list[Function]:
    """The functions so that each comes after those whose variables it depends on.

    Raises:
        HarnessError: that cannot be, as they depend on each other in a circle.
    """
    waiting, sorted_ones = list(functions), []
    while waiting:
        open_columns = {int(f.columns[-1]) for f in waiting}
        free = [f for f in waiting if not open_columns & set(f.columns[:-1].tolist())]
        if not free:
            names = ", ".join(network.names(c).name for c in sorted(open_columns))
            raise HarnessError(f"{network.file}: {names} depend on each other in a circle; take one of the parents out")
        sorted_ones += free
        waiting = [f for f in waiting if f not in free]
    return sorted_ones


def total(variables: Sequence[Variable]) -> int:
    """Combinations of the values of some variables."""
    return math.prod(map(len, variables))


def labels(variables: Sequence[Variable]) -> list[str]:
    """Names of all combinations of values, the last variable running fastest."""
    return [",".join(names) for names in itertools.product(*(variable.values for variable in variables))]
