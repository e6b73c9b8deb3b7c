"""A model file's variables and functions as a domain: its visible part, its hidden factors, and its tables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.errors import HarnessError
from harness.formats import ending, limits, starting, touching
from harness.formats.ending import Outcomes
from harness.formats.network import Network, labels, total
from harness.formats.rules import Points, numbered
from harness.model import domain as domains
from harness.model import validation
from harness.model.domain import Domain
from harness.model.indexing import spans

_SHOWN = 4  # names in a list, of which there may be hundreds


@dataclass(frozen=True, eq=False)
class Structure:
    """Which state variables are what: all visible ones together, and the hidden ones in factors."""

    network: Network
    factors: tuple[tuple[int, ...], ...]
    """State variables of each factor."""
    factor: NDArray[np.int64]
    """(V·A,) which a step touches; −1 for none."""

    @property
    def sizes(self) -> list[int]:
        """Values of each factor."""
        return [total([self.network.states[j] for j in members]) for members in self.factors]

    def note(self) -> str:
        """What the file's variables have become, in one line."""
        visible = [f"{self.network.states[j].name} ({len(self.network.states[j])})" for j in self.network.visible]
        hidden = [
            f"{'+'.join(self.network.states[j].name for j in members)} ({size:,})"
            for members, size in zip(self.factors, self.sizes, strict=True)
        ]
        merged = "" if len(self.factors) == len(self.network.hidden) else ", as steps or the start tie variables"
        return f"visible: {_listed(visible)}; hidden factors: {_listed(hidden)}{merged}"


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return ", ".join(names[:_SHOWN]) + more or "none"


def assemble(network: Network, name: str, title: str) -> Domain:
    """The domain of a model file.

    Raises:
        HarnessError: a function is no distribution somewhere, the model is too large, or does not fit a domain.
    """
    pairs = _pairs(network)
    structure = _structure(network, pairs)
    steps = _steps(structure, pairs)
    begin = starting.start(network, structure.factors)
    steps, begin = ending.ended(structure.sizes, steps, begin, always=not network.visible)
    arrays = {**steps.arrays(), **begin.arrays(structure.sizes), "visible_values": _visible_values(network, steps)}
    made = domains.from_export({**_record(structure, steps), "name": name, "title": title}, arrays)
    for breach in validation.breaches(made):
        raise HarnessError(f"{network.file}: {breach}")
    return made


def _pairs(network: Network) -> Points:
    """(V·A, C) all visible values, each with all actions."""
    c = network.columns
    columns = [*(c.before(j) for j in network.visible), *(c.action(i) for i in range(c.actions))]
    sizes = [len(network.names(column)) for column in columns]
    count = total([network.names(column) for column in columns])
    limits.check(f"{network.file}: visible values × actions", count, limits.LARGEST_ROWS, "make the model smaller")
    points = np.zeros((count, c.count), dtype=np.int64)
    for column, values in zip(columns, np.unravel_index(np.arange(count), sizes) if sizes else (), strict=True):
        points[:, column] = values
    return points


def _structure(network: Network, pairs: Points) -> Structure:
    """Hidden variables that a step touches together, or whose starts hang on each other, make one factor."""
    if len(network.states) == 1 and not network.visible:  # the whole state, as harness.model.domain has it of Julia's
        return Structure(network, ((0,),), np.zeros(len(pairs), dtype=np.int64))
    touched = touching.touched(network, pairs)
    tied = touching.correlated(network, starting.visible_starts(network)[0])
    leader = _leaders(len(network.hidden), [*_different(touched), *(tied | np.eye(len(tied), dtype=np.bool_))])
    first = sorted(set(leader))
    factors = tuple(tuple(j for j, of in zip(network.hidden, leader, strict=True) if of == each) for each in first)
    for members in factors:
        names = ", ".join(network.states[j].name for j in members)
        what = f"{network.file}: the values of {names} together, which steps or the start tie"
        count = total([network.states[j] for j in members])
        limits.check(what, count, limits.LARGEST_FACTOR, "write it with fewer or smaller variables")
    of_variable = [first.index(each) for each in leader]
    factor = np.full(len(pairs), -1, dtype=np.int64)
    for i, k in enumerate(of_variable):
        factor[touched[:, i]] = k
    return Structure(network, factors, factor)


def _different(rows: NDArray[np.bool_]) -> NDArray[np.bool_]:
    return np.unique(rows, axis=0) if rows.shape[1] else rows[:0]


def _leaders(n: int, sets: Sequence[NDArray[np.bool_]]) -> list[int]:
    """Of n things, the first one of all that are together in some set, directly or over others."""
    leader = list(range(n))
    for members in sets:
        together = {leader[i] for i in np.flatnonzero(members)}
        leader = [min(together) if each in together else each for each in leader]
    return leader


def _steps(structure: Structure, pairs: Points) -> Outcomes:
    """Rows and their outcomes, in the order of the next states."""
    network, c = structure.network, structure.network.columns
    rows, pair = _rows(structure, pairs)
    points, row, weight = network.distributed([network.moves[j] for j in network.visible], rows)
    pieces = []
    for k in range(-1, len(structure.factors)):
        mine = np.flatnonzero(structure.factor[pair[row]] == k)
        members = structure.factors[k] if k >= 0 else ()
        there, of, share = network.distributed([network.moves[j] for j in members], points[mine])
        value = _raveled(network, there, [c.after(j) for j in members])
        pieces.append((there, row[mine][of], weight[mine][of] * share, value))
    points, row, weight, value = (np.concatenate(parts) for parts in zip(*pieces, strict=True))
    visible = _raveled(network, points, [c.after(j) for j in network.visible])
    order = np.lexsort((value, visible, row))
    points, row, weight = points[order], row[order], weight[order]
    reading, readings, reward = _seen_and_paid(network, points)
    return Outcomes(
        np.zeros(total([network.states[j] for j in network.visible]), dtype=np.bool_), structure.factor,
        pair, row, visible[order], value[order], weight, reading, reward, readings,
    )  # fmt: skip


def _rows(structure: Structure, pairs: Points) -> tuple[Points, NDArray[np.int64]]:
    """Every pair with all values of the factor that it touches, and which pair each is from."""
    network, c = structure.network, structure.network.columns
    size = np.array([*structure.sizes, 1])[structure.factor]
    what = f"{network.file}: visible values × actions × values of the factor touched"
    limits.check(what, int(size.sum()), limits.LARGEST_ROWS, "make the model smaller")
    pair = np.repeat(np.arange(len(pairs)), size)
    value = np.arange(len(pair)) - np.repeat(np.cumsum(size) - size, size)
    rows = pairs[pair]
    for k, members in enumerate(structure.factors):
        mine = np.flatnonzero(structure.factor[pair] == k)
        values = np.unravel_index(value[mine], [len(network.states[j]) for j in members])
        for j, of_it in zip(members, values, strict=True):
            rows[mine, c.before(j)] = of_it
    return rows, pair


def _raveled(network: Network, points: Points, columns: Sequence[int]) -> NDArray[np.int64]:
    """(n,) the joint value of some columns, the last one running fastest."""
    index = np.zeros(len(points), dtype=np.int64)
    for column in columns:
        index = index * len(network.names(column)) + points[:, column]
    return index


def _seen_and_paid(
    network: Network, points: Points
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Of outcomes (n, C): number of the distribution of readings, these distributions, and the reward."""
    c = network.columns
    case = numbered(points, [x for x in range(c.reading(0)) if any(x in f.inputs for f in network.seen)])
    _, first = np.unique(case, return_index=True)
    seen, of, weight = network.distributed(network.seen, points[first])
    o = _raveled(network, seen, [c.reading(i) for i in range(c.readings)])
    order = np.lexsort((o, of))
    seen, of, weight, o = seen[order], of[order], weight[order], o[order]
    number, firsts = touching.alike(len(first), of, o, weight)
    n_readings = total(network.readings)
    what = f"{network.file}: numbers in {len(firsts):,} distributions of {n_readings:,} observations"
    limits.check(what, len(firsts) * n_readings, limits.LARGEST_READINGS, "make the model smaller")
    table = np.zeros((len(firsts), n_readings))
    table[number[of], o] = weight
    return number[case], table, _paid(network, points, case, (seen, of, weight))


def _paid(
    network: Network, points: Points, case: NDArray[np.int64], seen: tuple[Points, NDArray[np.int64], NDArray[Any]]
) -> NDArray[np.float64]:
    """(n,) the reward; where it depends on the reading, what is expected of it."""
    first_reading = network.columns.reading(0)
    reward = np.zeros(len(points))
    for function in network.paid:
        if max(function.inputs, default=0) >= first_reading:
            reward += _expected(function.values, points, case, seen, first_reading)
        else:
            reward += function.values(points)
    return reward


def _expected(
    values: Any,
    points: Points,
    case: NDArray[np.int64],
    seen: tuple[Points, NDArray[np.int64], NDArray[Any]],
    first_reading: int,
) -> NDArray[np.float64]:
    read, of, weight = seen
    begin, count = np.searchsorted(of, case), np.bincount(of)[case]
    what = "outcomes × readings, for a reward that depends on the reading"
    limits.check(what, int(count.sum()), limits.LARGEST_OUTCOMES, "let the reward depend on less")
    entry, outcome = spans(begin, count)
    there = points[outcome]
    there[:, first_reading:] = read[entry, first_reading:]
    paid, first = values(there), np.cumsum(count) - count
    low, high = np.minimum.reduceat(paid, first), np.maximum.reduceat(paid, first)
    return np.where(low == high, low, np.add.reduceat(paid * weight[entry], first))


def _visible_values(network: Network, steps: Outcomes) -> NDArray[np.int64]:
    """(V, numbers) the values of the visible variables; one more column says what has ended, where that is a value."""
    sizes = [len(network.states[j]) for j in network.visible]
    count, added = total([network.states[j] for j in network.visible]), len(steps.terminal)
    values = np.zeros((added, len(sizes) + 1), dtype=np.int64)
    if sizes:
        values[:count, :-1] = np.array(np.unravel_index(np.arange(count), sizes)).T
    values[count:, -1] = 1
    return values if added > count else values[:, :-1]


def _record(structure: Structure, steps: Outcomes) -> dict[str, Any]:
    network = structure.network
    of_factors = [[network.states[j] for j in members] for members in structure.factors]
    factor_labels = [labels(variables) for variables in of_factors]
    live, visible = len(steps.terminal) - int(steps.terminal.sum()), total([network.states[j] for j in network.visible])
    ended = ["ended"] if len(steps.terminal) > visible else []
    joint = total([network.states[j] for j in network.hidden])
    terminal = int(steps.terminal[:visible].sum())
    return {
        "version": 0,
        "discount": network.discount,
        "states": min(live * joint + terminal, validation.LARGEST_WHOLE),
        "actions": labels(network.actions),
        "observations": labels(network.readings) if network.readings else ["none"],
        "visible": [network.states[j].name for j in network.visible] + ended,
        "factors": ["+".join(each.name for each in variables) for variables in of_factors],
        "factor_labels": factor_labels,
        "features": _features(factor_labels),
        "shapings": ["none"],
        "layout": {"kind": "none"},
        "provenance": {"model file": network.file, "notes": _notes(structure)},
    }


def _features(factor_labels: list[list[str]]) -> list[tuple[str, int, int]]:
    """Every value of a factor; of one with two values only the second, where there are several factors."""
    shown = [
        (k, x)
        for k, names in enumerate(factor_labels)
        for x in range(1 if len(names) == 2 and len(factor_labels) > 1 else 0, len(names))
    ]
    return [(f"belief({i})", k, x) for i, (k, x) in enumerate(shown, 1)]


def _notes(structure: Structure) -> list[str]:
    network = structure.network
    notes = [structure.note()]
    first_reading = network.columns.reading(0)
    if any(max(f.inputs, default=0) >= first_reading for f in network.paid):
        notes.append("the reward that depends on the reading is what is expected of it, as the tables hold one a step")
    if network.scaled[0]:
        notes.append(f"{network.scaled[0]:,} distributions were scaled to sum to 1; the file rounds them")
    return notes
