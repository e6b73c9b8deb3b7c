"""A script as a tour: the places (:mod:`harness.ge.moves`) where it does something, and the ways between them.

In an open-loop script a detour shifts all that comes after. Read as a tour, it can be changed in one place while the
rest goes on from where it always did: a stop that is put in, taken out or put elsewhere gets ways to and from it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from harness.ge.mapping import Codons
from harness.ge.moves import Moves
from harness.ge.vocabulary import Vocabulary

Items = tuple[Codons, ...]


class Stop(NamedTuple):
    """A place, how it is reached from the stop before, and the statements executed there."""

    place: int
    way: Items | None
    """None: by a shortest way."""
    acts: Items


def read(
    items: Sequence[Codons], start: int, moves: Moves, vocabulary: Vocabulary, taken: Callable[[], bool]
) -> list[Stop]:
    """The tour of a list of statements; ``taken`` says of each guarded move whether it counts as executed."""
    stops: list[Stop] = []
    place, way, acts = start, list[Codons](), list[Codons]()
    for item in items:
        action, guarded, *_ = vocabulary.meaning(item)
        if action < 0 or not moves.moves(place, action) or (guarded and not taken()):
            acts.append(item)
            continue
        if acts:
            stops.append(Stop(place, tuple(way), tuple(acts)))
            way, acts = [], []
        place = int(moves.leads[place, action])
        way.append(item)
    return [*stops, Stop(place, tuple(way), tuple(acts))]


def written(stops: Sequence[Stop], start: int, moves: Moves, vocabulary: Vocabulary) -> list[Codons] | None:
    """The statements of a tour; None where there is no way to a stop, or no statement for a move."""
    items: list[Codons] = []
    place = start
    for stop in stops:
        way = stop.way if stop.way is not None else _way(moves.path(place, stop.place), vocabulary.plain.get)
        if way is None:
            return None
        items += [*way, *stop.acts]
        place = stop.place
    return items


def _way(path: Sequence[int] | None, spell: Callable[[int], Codons | None]) -> Items | None:
    if path is None:
        return None
    spelled = [spell(action) for action in path]
    return None if any(item is None for item in spelled) else tuple(item for item in spelled if item is not None)


def inserted(stops: Sequence[Stop], at: int, new: Sequence[Stop]) -> list[Stop]:
    """The tour with stops put before the one of a number; the way to that one is sought anew."""
    return [*stops[:at], *(stop._replace(way=None) for stop in new), *_sought(stops[at:])]


def removed(stops: Sequence[Stop], begin: int, end: int) -> list[Stop]:
    """The tour without the stops ``begin … end − 1``."""
    return [*stops[:begin], *_sought(stops[end:])]


def _sought(stops: Sequence[Stop]) -> list[Stop]:
    return [stops[0]._replace(way=None), *stops[1:]] if stops else []
