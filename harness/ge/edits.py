"""Edits of programs by statements, and of scripts by the way they go: material of a mutation and of a local search.

Statements are inserted, deleted, replaced, swapped and shifted wherever the grammar lists them
(:mod:`harness.ge.statements`). With ``walks`` a script is also edited as a tour (:mod:`harness.ge.tour`): a stop is put
in, taken out or put elsewhere, some are visited in reverse order (the 2-opt move of tours, Croes 1958), a way is made
the shortest. What comes after an edit then happens where it did before. Where a grammar has statements that lead to a
place from anywhere (:mod:`harness.ge.homing`), whole visits are put in instead. Nothing of a domain is known here but
its tables, where its moves lead and what pays; so a search with walks is no longer one of a black box.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

from harness.ge import tour
from harness.ge.grammar import Grammar
from harness.ge.lexicon import Lexicon
from harness.ge.mapping import Codons, derive
from harness.ge.moves import Moves
from harness.ge.operators import Parent, fresh, replaced
from harness.ge.parameters import NOWHERE, PAYING, Parameters
from harness.ge.statements import Listing, put
from harness.ge.tour import Stop
from harness.ge.visits import Rng, Visits, one
from harness.model.domain import Domain
from harness.program import words_of

_T = TypeVar("_T")

_TRAVELS = 0.5
"""Share of the edits that are of where a program goes, where there are walks."""
_INFORMED = 0.75
"""Of the blocks put behind a condition: share that first make the reading asked for."""
_TAKEN = (0.0, 0.5, 1.0)
"""Share of the guarded moves that a reading of a tour takes for executed: any, as nothing plays the script."""
_STRETCHED = 0.5
"""Share of the blocks whose end is put elsewhere that take in what follows."""
_RUN = 0.5
"""Probability that a run of statements or stops that is edited together has one more."""


class Editor:
    """Makes one edit of an individual at a time. Randomness is an argument; individuals are never changed."""

    def __init__(self, grammar: Grammar, domain: Domain, p: Parameters) -> None:
        """``domain``: whose words and tables count."""
        self.grammar, self.codon_size = grammar, p.codon_size
        self._lexicon = Lexicon(grammar, words_of(domain), p.codon_size)
        self._visits = None if p.walks == NOWHERE else Visits(self._lexicon, Moves(domain), p.walks == PAYING)

    def mutate(self, grammar: Grammar, a: Parent, probability: float, codon_size: int, rng: Rng) -> Codons:
        """As a mutation (:data:`harness.ge.loop.Mutate`), of the grammar and codon size that it was made for."""
        return self.mutated(a, probability, rng)

    def mutated(self, a: Parent, probability: float, rng: Rng) -> Codons:
        """Edit again and again as long as chance has it: each time with the given probability."""
        while a.has_tree and rng.random() < probability:
            codons = self.edited(a, rng)
            a = Parent(codons, derive(self.grammar, codons))
        return a.codons

    def edited(self, a: Parent, rng: Rng) -> Codons:
        """One edit; where a grammar has no list, a new subtree."""
        lists = self._lexicon.listings(a)
        if not lists:
            return replaced(self.grammar, a, self.codon_size, rng)
        if self._visits is not None and rng.random() < _TRAVELS:
            codons = _travelled(self._visits, a, lists, rng)
            if not np.array_equal(codons, a.codons):  # as where a grammar has no statements that are moves
                return codons
        return self._statements(a, _listing(lists, rng), rng)

    def _statements(self, a: Parent, listing: Listing, rng: Rng) -> Codons:
        of_blocks = (self._wrapped, self._unwrapped, self._stretched) if self._lexicon.frames(listing.shape) else ()
        simple = len(_STATEMENT_EDITS)
        kind = int(rng.integers(simple + 1 + len(of_blocks)))
        if kind == simple:
            return replaced(self.grammar, a, self.codon_size, rng)
        if kind > simple:
            return put(a.codons, listing, of_blocks[kind - simple - 1](listing, rng))

        def make() -> Codons:
            return fresh(self.grammar, listing.shape.item, self.codon_size, rng)

        return put(a.codons, listing, _STATEMENT_EDITS[kind](list(listing.items), make, rng))

    def _wrapped(self, listing: Listing, rng: Rng) -> Sequence[Codons]:
        """A run of statements becomes the block of a compound one, after a reading that its condition asks for."""
        lexicon, shape = self._lexicon, listing.shape
        begin, end = _run(len(listing.items), rng)
        frame = one(lexicon.frames(shape), rng)
        block = put(frame, one(lexicon.blocks(shape, frame), rng), listing.items[begin:end])
        telling = lexicon.telling(shape, lexicon.vocabulary(shape).meaning(frame).registers)
        first = [one(telling, rng)] if telling and rng.random() < _INFORMED else []
        return [*listing.items[:begin], *first, block, *listing.items[end:]]

    def _unwrapped(self, listing: Listing, rng: Rng) -> Sequence[Codons]:
        """The statements of a block take the place of the statement that it is in."""
        at = int(rng.integers(len(listing.items)))
        blocks = self._lexicon.blocks(listing.shape, listing.items[at])
        inner = one(blocks, rng).items if blocks else listing.items[at : at + 1]
        return [*listing.items[:at], *inner, *listing.items[at + 1 :]]

    def _stretched(self, listing: Listing, rng: Rng) -> Sequence[Codons]:
        """The end of a block is put elsewhere: it takes in some of what follows, or leaves out its last statements."""
        at = int(rng.integers(len(listing.items)))
        before, item, after = listing.items[:at], listing.items[at], listing.items[at + 1 :]
        blocks = self._lexicon.blocks(listing.shape, item)
        if not blocks:
            return listing.items
        block = one(blocks, rng)
        inner, count = block.items, int(rng.geometric(1 - _RUN))
        if rng.random() < _STRETCHED:
            return [*before, put(item, block, [*inner, *after[:count]]), *after[count:]]
        left = inner[: max(len(inner) - count, 1)]
        return [*before, put(item, block, left), *inner[len(left) :], *after]


def _listing(lists: Sequence[Listing], rng: Rng) -> Listing:
    """One of some lists, the likelier the more items it has."""
    sizes = np.cumsum([len(each.items) for each in lists])
    return lists[int(np.searchsorted(sizes, rng.integers(sizes[-1]), side="right"))]


def _travelled(visits: Visits, a: Parent, lists: Sequence[Listing], rng: Rng) -> Codons:
    """An edit of where the program goes: of its visits, where statements find their way from anywhere; otherwise the
    script is changed as a tour."""
    listing = _listing(lists, rng)
    if visits.homing(listing.shape).ways:
        return put(a.codons, listing, list(itertools.chain(*_visited(visits, listing, rng))))
    script = _toured(visits, lists[0], rng) if lists[0].end == a.used else None
    return put(a.codons, lists[0], script) if script else a.codons


def _visited(visits: Visits, listing: Listing, rng: Rng) -> list[tuple[Codons, ...]]:
    """The statements of a list, visit by visit, with one more visit, another way to make one, or in another order."""
    parts = visits.parts(listing.shape, listing.items)

    def make() -> tuple[Codons, ...]:
        return tuple(visits.visit(listing.shape, rng))

    kind = int(rng.integers(3))
    if kind == 1:
        at = int(rng.integers(len(parts)))
        return [*parts[:at], tuple(visits.anew(listing.shape, parts[at], rng)), *parts[at + 1 :]]
    return one(_VISIT_EDITS, rng)(parts, make, rng) if kind else _insert(parts, make, rng)


def _toured(visits: Visits, listing: Listing, rng: Rng) -> list[Codons] | None:
    """A script after an edit of its tour; None or empty where that cannot be."""
    moves, vocabulary = visits.moves, visits.lexicon.vocabulary(listing.shape)
    start, often = one(moves.starts, rng), one(_TAKEN, rng)
    stops = tour.read(listing.items, start, moves, vocabulary, lambda: bool(rng.random() < often))
    kind = int(rng.integers(2 * len(_TOUR_EDITS)))
    if kind < len(_TOUR_EDITS):
        return tour.written(_TOUR_EDITS[kind](stops, rng), start, moves, vocabulary)
    at = int(rng.integers(len(stops) + 1))
    stop = visits.stop(listing.shape, stops[at - 1].place if at else start, rng)
    return None if stop is None else tour.written(tour.inserted(stops, at, [stop]), start, moves, vocabulary)


def _run(count: int, rng: Rng) -> tuple[int, int]:
    """Begin and end of a short run among ``count``."""
    begin = int(rng.integers(count))
    return begin, min(begin + int(rng.geometric(1 - _RUN)), count)


_Make = Callable[[], _T]
"""What makes something new to be put in: a statement, or a visit."""


def _insert(items: list[_T], make: _Make[_T], rng: Rng) -> list[_T]:
    at = int(rng.integers(len(items) + 1))
    return [*items[:at], make(), *items[at:]]


def _copy(items: list[_T], make: _Make[_T], rng: Rng) -> list[_T]:
    (begin, end), at = _run(len(items), rng), int(rng.integers(len(items) + 1))
    return [*items[:at], *items[begin:end], *items[at:]]


def _delete(items: list[_T], make: _Make[_T], rng: Rng) -> list[_T]:
    begin, end = _run(len(items), rng)
    return [*items[:begin], *items[end:]] if end - begin < len(items) else items


def _delete_two(items: list[_T], make: _Make[_T], rng: Rng) -> list[_T]:
    """Such as two moves that undo each other."""
    gone = rng.choice(len(items), 2, replace=False) if len(items) > 2 else ()
    return [item for i, item in enumerate(items) if i not in gone]


def _replace(items: list[_T], make: _Make[_T], rng: Rng) -> list[_T]:
    at = int(rng.integers(len(items)))
    return [*items[:at], make(), *items[at + 1 :]]


def _swap(items: list[_T], make: _Make[_T], rng: Rng) -> list[_T]:
    i, j = (int(k) for k in rng.integers(len(items), size=2))
    items[i], items[j] = items[j], items[i]
    return items


def _shift(items: list[_T], make: _Make[_T], rng: Rng) -> list[_T]:
    begin, end = _run(len(items), rng)
    rest = [*items[:begin], *items[end:]]
    at = int(rng.integers(len(rest) + 1))
    return [*rest[:at], *items[begin:end], *rest[at:]]


def _reverse(items: list[_T], make: _Make[_T], rng: Rng) -> list[_T]:
    begin, end = sorted(int(k) for k in rng.integers(len(items) + 1, size=2))
    return [*items[:begin], *items[begin:end][::-1], *items[end:]]


_STATEMENT_EDITS = (_insert, _copy, _delete, _delete_two, _replace, _swap, _shift)
_VISIT_EDITS = (_delete, _swap, _shift, _reverse)


def _drop_stops(stops: list[Stop], rng: Rng) -> list[Stop]:
    return tour.removed(stops, *_run(len(stops), rng))


def _shift_stops(stops: list[Stop], rng: Rng) -> list[Stop]:
    begin, end = _run(len(stops), rng)
    rest = tour.removed(stops, begin, end)
    return tour.inserted(rest, int(rng.integers(len(rest) + 1)), stops[begin:end])


def _reverse_stops(stops: list[Stop], rng: Rng) -> list[Stop]:
    begin, end = sorted(int(k) for k in rng.integers(len(stops) + 1, size=2))
    return tour.inserted(tour.removed(stops, begin, end), begin, stops[begin:end][::-1])


def _straighten(stops: list[Stop], rng: Rng) -> list[Stop]:
    at = int(rng.integers(len(stops)))
    return tour.inserted(stops[:at] + stops[at + 1 :], at, [stops[at]])


_TOUR_EDITS = (_drop_stops, _shift_stops, _reverse_stops, _straighten)
