"""Functions of discrete variables as rules, of which the last one that fits decides.

Both file formats define transitions, readings and rewards so: a statement names values of some variables, wildcards
for the others, and what holds there, until a later statement says otherwise. Kept as they are, rules take as much
memory as the file has numbers, however large the space is that the wildcards span.
"""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from harness.errors import HarnessError
from harness.formats import limits
from harness.model.indexing import spans

ANY = -1
"""In a rule, of a variable: whatever its value (``*``)."""
EACH = -2
"""In a table, of a variable: a number for each of its values (``-``)."""
_LONGEST_KEY = 2**62

Points = NDArray[np.int64]
"""(n, C) values of the model's variables, one column each (:class:`harness.formats.network.Columns`)."""


@dataclass
class _Pile:
    """Rules that name the same variables, as they come."""

    strides: tuple[int, ...]
    keys: array[int] = field(default_factory=lambda: array("q"))
    turns: array[int] = field(default_factory=lambda: array("q"))
    numbers: array[float] = field(default_factory=lambda: array("d"))


@dataclass(frozen=True, eq=False)
class Group:
    """The rules of a function that name the same variables; of each combination of values, the last one."""

    named: NDArray[np.int64]
    """Positions of these variables among the function's."""
    sizes: NDArray[np.int64]
    """Their numbers of values."""
    strides: NDArray[np.int64]
    keys: NDArray[np.int64]
    """Ascending: values times strides."""
    turns: NDArray[np.int64]
    """Which statement of the function a rule comes from."""
    numbers: NDArray[np.float64]

    def part(self, positions: NDArray[np.bool_]) -> NDArray[np.int64]:
        """The keys as if only some of the variables were named."""
        total = np.zeros(len(self.keys), dtype=np.int64)
        for size, stride in zip(self.sizes[positions], self.strides[positions], strict=True):
            total += self.keys // stride % size * stride
        return total


@dataclass(frozen=True, eq=False)
class Function:
    """A value, or a conditional distribution of the last of its variables, by the values of the others."""

    columns: NDArray[np.int64]
    """Where its variables are in points."""
    sizes: tuple[int, ...]
    groups: tuple[Group, ...]
    lines: NDArray[np.int64]
    """Line of the file for each statement; entry 0 is where the function begins."""
    is_value: bool = False
    """Whether all its variables are ones that it depends on."""

    @cached_property
    def inputs(self) -> list[int]:
        """Columns that some rule names, and that it depends on."""
        named = {i for group in self.groups for i in group.named.tolist()}
        of = len(self.columns) - (0 if self.is_value else 1)
        return [int(self.columns[i]) for i in sorted(named) if i < of]

    def values(self, points: Points) -> NDArray[np.float64]:
        """(n,) what the last rule that fits says at each point; 0 where none does."""
        return self._decided(points)[0]

    def line(self, point: Points) -> int:
        """Line of the file that decides at a point (1, C), the function's own where none does."""
        return int(self.lines[self._decided(point)[1][0]])

    def _decided(self, points: Points) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        numbers, turns = np.zeros(len(points)), np.zeros(len(points), dtype=np.int64)
        for group in self.groups:
            key = points[:, self.columns[group.named]] @ group.strides
            place = np.minimum(np.searchsorted(group.keys, key), len(group.keys) - 1)
            newer = (group.keys[place] == key) & (group.turns[place] > turns)
            numbers[newer], turns[newer] = group.numbers[place[newer]], group.turns[place[newer]]
        return numbers, turns

    def spread(self, points: Points) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
        """The values of the last variable that are not 0: of which point, which value, and the number.

        Raises:
            HarnessError: there are more than :data:`harness.formats.limits.LARGEST_OUTCOMES`.
        """
        found = [self._candidates(group, points) for group in self.groups if group.numbers.any()]
        where = np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *found]))
        point, value = where // self.sizes[-1], where % self.sizes[-1]
        there = points[point]
        there[:, self.columns[-1]] = value
        number = self.values(there)
        kept = number != 0
        return point[kept], value[kept], number[kept]

    def _candidates(self, group: Group, points: Points) -> NDArray[np.int64]:
        """point · size + value wherever a rule of the group says something else than 0."""
        last, some = len(self.sizes) - 1, group.numbers != 0
        keys, size = group.keys[some], self.sizes[last]
        given = group.named != last
        key = points[:, self.columns[group.named[given]]] @ group.strides[given]
        if given.all():  # the same for every value
            keys = np.repeat(keys, size)
            values = np.tile(np.arange(size), len(keys) // size)
        else:
            keys, values = keys // size * size, keys % size
        first, end = np.searchsorted(keys, key, "left"), np.searchsorted(keys, key, "right")
        what = f"the values of a variable of {size:,} in {len(points):,} cases"
        limits.check(what, int((end - first).sum()), limits.LARGEST_OUTCOMES, "a smaller or sparser model is needed")
        place, point = spans(first, end - first)
        return point * size + values[place]


class Rules:
    """Collects the rules of one function in the order of its file."""

    def __init__(self, columns: Sequence[int], sizes: Sequence[int], line: int = 0) -> None:
        """For the variables in ``columns`` with ``sizes`` values; ``line`` is where the function begins."""
        self.columns, self.sizes = tuple(columns), tuple(sizes)
        self._lines = array("q", [line])
        self._piles: dict[tuple[int, ...], _Pile] = {}

    def add(self, where: Sequence[int], number: float, line: int) -> None:
        """One number at the values ``where``, of which some may be :data:`ANY`."""
        named = tuple([i for i, value in enumerate(where) if value >= 0])
        pile = self._piles.get(named) or self._pile(named)
        pile.keys.append(sum([where[i] * stride for i, stride in zip(named, pile.strides, strict=True)]))
        pile.turns.append(len(self._lines))
        pile.numbers.append(number)
        self._lines.append(line)

    def add_table(self, where: Sequence[int], table: Sequence[float], line: int) -> None:
        """A number for every value of the variables that are :data:`EACH`, the last one running fastest."""
        each = [i for i, value in enumerate(where) if value == EACH]
        if each != list(range(len(where) - len(each), len(where))):
            values = np.indices([self.sizes[i] for i in each]).reshape(len(each), -1)
            self.add_many(where, each, values, np.array(table), line)
            return
        named = tuple([i for i, value in enumerate(where) if value != ANY])  # and their keys follow each other
        pile = self._piles.get(named) or self._pile(named)
        first = sum([where[i] * stride for i, stride in zip(named, pile.strides, strict=True) if where[i] >= 0])
        pile.keys.extend(range(first, first + len(table)))
        pile.turns.extend([len(self._lines)] * len(table))
        pile.numbers.extend(table)
        self._lines.append(line)

    def add_identity(self, where: Sequence[int], line: int) -> None:
        """1 where the two variables that are :data:`EACH` are equal, 0 elsewhere."""
        each = [i for i, value in enumerate(where) if value == EACH]
        self.add([ANY if value == EACH else value for value in where], 0.0, line)
        same = np.arange(self.sizes[each[0]])
        self.add_many(where, each, np.array([same, same]), np.ones(len(same)), line)

    def add_many(
        self,
        where: Sequence[int],
        each: Sequence[int],
        values: NDArray[np.int64],
        numbers: NDArray[np.float64],
        line: int,
    ) -> None:
        """Numbers (n,) at ``where`` with ``values`` (len(each), n) of the variables ``each``."""
        named = tuple(i for i, value in enumerate(where) if value >= 0 or i in each)
        pile = self._piles.get(named) or self._pile(named)
        stride = dict(zip(named, pile.strides, strict=True))
        key = np.full(len(numbers), sum(where[i] * stride[i] for i in named if where[i] >= 0), dtype=np.int64)
        for i, of_it in zip(each, values, strict=True):
            key += of_it * stride[i]
        pile.keys.frombytes(key.tobytes())
        pile.turns.frombytes(np.full(len(key), len(self._lines), dtype=np.int64).tobytes())
        pile.numbers.frombytes(np.asarray(numbers, dtype=np.float64).tobytes())
        self._lines.append(line)

    def _pile(self, named: tuple[int, ...]) -> _Pile:
        strides, total = [], 1
        for i in reversed(named):
            strides.append(total)
            total *= self.sizes[i]
        if total > _LONGEST_KEY:
            raise HarnessError("a table is over more variables than can be counted; split it into functions of fewer")
        return self._piles.setdefault(named, _Pile(tuple(reversed(strides))))

    def __len__(self) -> int:
        """Statements so far."""
        return len(self._lines) - 1

    def distribution(self) -> Function:
        """The conditional distribution that the rules define."""
        return self._function(False)

    def value(self) -> Function:
        """The value that the rules define."""
        return self._function(True)

    def _function(self, is_value: bool) -> Function:
        groups = tuple(self._group(named, pile) for named, pile in self._piles.items() if pile.keys)
        return Function(np.array(self.columns, dtype=np.int64), self.sizes, groups, np.array(self._lines), is_value)

    def _group(self, named: tuple[int, ...], pile: _Pile) -> Group:
        keys, turns = np.array(pile.keys, dtype=np.int64), np.array(pile.turns, dtype=np.int64)
        order = np.lexsort((turns, keys))
        last = order[np.append(np.diff(keys[order]) > 0, True)]
        sizes = np.array([self.sizes[i] for i in named], dtype=np.int64)
        strides = np.array(pile.strides, dtype=np.int64)
        numbers = np.array(pile.numbers, dtype=np.float64)
        return Group(np.array(named, dtype=np.int64), sizes, strides, keys[last], turns[last], numbers[last])


def grid(points: Points, columns: Sequence[int], sizes: Sequence[int]) -> Points:
    """Every point with every combination of values of some columns, the last one running fastest."""
    ways = np.indices(sizes).reshape(len(sizes), -1).T
    spread = np.repeat(points, len(ways), axis=0)
    spread[:, list(columns)] = np.tile(ways, (len(points), 1))
    return spread


def numbered(points: Points, columns: Sequence[int]) -> NDArray[np.int64]:
    """(n,) a number for every different combination of values in some columns, ascending with the values."""
    number = np.zeros(len(points), dtype=np.int64)
    for column in columns:
        wide = number * (points[:, column].max(initial=0) + 1) + points[:, column]
        number = np.unique(wide, return_inverse=True)[1].reshape(-1)
    return number
