"""Edits of programs by statements, and of scripts by the way they go: material of a mutation and of a local search.

Statements are inserted, deleted, replaced, swapped and shifted wherever the grammar lists them
(:mod:`harness.ge.statements`). With ``walks`` a script is also edited as a tour (:mod:`harness.ge.tour`): a stop is put
in, taken out or put elsewhere, some are visited in reverse order (the 2-opt move of tours, Croes 1958), a way is made
the shortest. What comes after an edit then happens where it did before. Nothing of a domain is known here but its
tables, where its moves lead and what pays; so a search with walks is no longer one of a black box.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

from harness.ge import tour
from harness.ge.grammar import Grammar
from harness.ge.mapping import Codons, derive
from harness.ge.moves import Moves, Pay
from harness.ge.operators import Parent, fresh, replaced
from harness.ge.parameters import NOWHERE, PAYING, Parameters
from harness.ge.statements import Listing, Shape, listings, put, shapes
from harness.ge.tour import Stop
from harness.ge.vocabulary import Vocabulary
from harness.model.domain import Domain
from harness.program import words_of

_T = TypeVar("_T")
Rng = np.random.Generator

_TOURS = 0.5
"""Share of the edits that are edits of a tour, where there are walks."""
_PAYING = 0.75
"""Of the stops put in with ``paying``: share of those where something pays; the others lead anywhere."""
_GUARDED, _INFORMED = 0.75, 0.75
"""Share of the stops whose act stands behind a condition; of these, share that first make the reading asked for."""
_TAKEN = (0.0, 0.5, 1.0)
"""Share of the guarded moves that a reading of a tour takes for executed: any, as nothing plays the script."""
_RUN = 0.5
"""Probability that a run of statements or stops that is edited together has one more."""


class Editor:
    """Makes one edit of an individual at a time. Randomness is an argument; individuals are never changed."""

    def __init__(self, grammar: Grammar, domain: Domain, p: Parameters) -> None:
        """``domain``: whose words and tables count."""
        self.grammar, self.words, self.codon_size = grammar, words_of(domain), p.codon_size
        self.paying = p.walks == PAYING
        self.moves = None if p.walks == NOWHERE else Moves(domain)
        self._shapes = shapes(grammar)
        self._vocabularies: dict[int, Vocabulary] = {}
        self._frames: dict[int, list[Codons]] = {}

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
        lists = listings(self._shapes, a)
        if not lists:
            return replaced(self.grammar, a, self.codon_size, rng)
        whole = lists[0].end == a.used
        if self.moves is not None and whole and rng.random() < _TOURS:
            items = self._tour(self.moves, lists[0], rng)
            codons = put(a.codons, lists[0], items) if items else a.codons
            if not np.array_equal(codons, a.codons):  # as where a grammar has no statements that are moves
                return codons
        return self._statements(a, lists, rng)

    def _statements(self, a: Parent, lists: Sequence[Listing], rng: Rng) -> Codons:
        sizes = np.cumsum([len(each.items) for each in lists])
        listing = lists[int(np.searchsorted(sizes, rng.integers(sizes[-1]), side="right"))]
        simple = len(_STATEMENT_EDITS)
        kind = int(rng.integers(simple + (3 if self._with_blocks(listing.shape) else 1)))
        if kind == simple:
            return replaced(self.grammar, a, self.codon_size, rng)
        if kind > simple:
            edit = self._wrapped if kind == simple + 1 else self._unwrapped
            return put(a.codons, listing, edit(listing, rng))

        def make() -> Codons:
            return fresh(self.grammar, listing.shape.item, self.codon_size, rng)

        return put(a.codons, listing, _STATEMENT_EDITS[kind](list(listing.items), make, rng))

    def _wrapped(self, listing: Listing, rng: Rng) -> Sequence[Codons]:
        """A run of statements becomes the block of a compound one, after a reading that its condition asks for."""
        vocabulary = self._vocabulary(listing.shape.item)
        begin, end = _run(len(listing.items), rng)
        frame = _one(self._with_blocks(listing.shape), rng)
        block = put(frame, _one(self._blocks(listing.shape, frame), rng), listing.items[begin:end])
        asked = vocabulary.meaning(frame).registers
        telling = [codons for action, codons in vocabulary.plain.items() if self.words.register[action] in asked]
        first = [_one(telling, rng)] if telling and rng.random() < _INFORMED else []
        return [*listing.items[:begin], *first, block, *listing.items[end:]]

    def _unwrapped(self, listing: Listing, rng: Rng) -> Sequence[Codons]:
        """The statements of a block take the place of the statement that it is in."""
        at = int(rng.integers(len(listing.items)))
        blocks = self._blocks(listing.shape, listing.items[at])
        inner = _one(blocks, rng).items if blocks else listing.items[at : at + 1]
        return [*listing.items[:at], *inner, *listing.items[at + 1 :]]

    def _with_blocks(self, shape: Shape) -> list[Codons]:
        """The statements of the vocabulary that have a block for others of their kind."""
        if shape.rule not in self._frames:
            compound = self._vocabulary(shape.item).compound
            self._frames[shape.rule] = [item for item in compound if self._blocks(shape, item)]
        return self._frames[shape.rule]

    def _blocks(self, shape: Shape, item: Codons) -> list[Listing]:
        """Lists of the same rule within a statement."""
        within = listings(self._shapes, Parent(item, derive(self.grammar, item, start=shape.item)))
        return [each for each in within if each.shape == shape]

    def _tour(self, moves: Moves, listing: Listing, rng: Rng) -> list[Codons] | None:
        """The list's statements after an edit of its tour; None or empty where that cannot be."""
        vocabulary = self._vocabulary(listing.shape.item)
        start = _one(moves.starts, rng)
        often = _one(_TAKEN, rng)
        stops = tour.read(listing.items, start, moves, vocabulary, lambda: bool(rng.random() < often))
        kind = int(rng.integers(2 * len(_TOUR_EDITS)))
        if kind < len(_TOUR_EDITS):
            return tour.written(_TOUR_EDITS[kind](stops, rng), start, moves, vocabulary)
        at = int(rng.integers(len(stops) + 1))
        stop = self._stop(moves, vocabulary, stops[at - 1].place if at else start, rng)
        return None if stop is None else tour.written(tour.inserted(stops, at, [stop]), start, moves, vocabulary)

    def _vocabulary(self, rule: int) -> Vocabulary:
        if rule not in self._vocabularies:
            self._vocabularies[rule] = Vocabulary(self.grammar, self.words, rule, self.codon_size)
        return self._vocabularies[rule]

    def _stop(self, moves: Moves, vocabulary: Vocabulary, origin: int, rng: Rng) -> Stop | None:
        """A new stop that can be reached, and what is done there."""
        if self.paying and moves.pays and rng.random() < _PAYING:
            place, action = _one(moves.pays, rng)
        else:
            place = _one(moves.reached(origin), rng)
            staying = np.flatnonzero(moves.leads[place] == place).tolist()
            if not staying:
                return None
            action = _one(staying, rng)
        acts = self._acts(moves, vocabulary, Pay(place, action), rng)
        return Stop(place, None, acts) if acts else None

    def _acts(self, moves: Moves, vocabulary: Vocabulary, what: Pay, rng: Rng) -> tuple[Codons, ...]:
        """Statements that end in an action: behind a condition perhaps, and after a reading that tells of it."""
        guarded = vocabulary.guarded.get(what.action, [])
        if not guarded or rng.random() >= _GUARDED:
            plain = vocabulary.plain.get(what.action)
            return () if plain is None else (plain,)
        act = _one(guarded, rng)
        asked = vocabulary.meaning(act)
        telling = [
            codons
            for action, codons in vocabulary.plain.items()
            if moves.leads[what.place, action] == what.place
            and (self.words.register[action] in asked.registers or moves.factor[what.place, action] in asked.factors)
        ]
        return (_one(telling, rng), act) if telling and rng.random() < _INFORMED else (act,)


def _one(of: Sequence[_T], rng: Rng) -> _T:
    return of[int(rng.integers(len(of)))]


def _run(count: int, rng: Rng) -> tuple[int, int]:
    """Begin and end of a short run among ``count``."""
    begin = int(rng.integers(count))
    return begin, min(begin + int(rng.geometric(1 - _RUN)), count)


Make = Callable[[], Codons]


def _insert(items: list[Codons], make: Make, rng: Rng) -> list[Codons]:
    at = int(rng.integers(len(items) + 1))
    return [*items[:at], make(), *items[at:]]


def _copy(items: list[Codons], make: Make, rng: Rng) -> list[Codons]:
    (begin, end), at = _run(len(items), rng), int(rng.integers(len(items) + 1))
    return [*items[:at], *items[begin:end], *items[at:]]


def _delete(items: list[Codons], make: Make, rng: Rng) -> list[Codons]:
    begin, end = _run(len(items), rng)
    return [*items[:begin], *items[end:]] if end - begin < len(items) else items


def _delete_two(items: list[Codons], make: Make, rng: Rng) -> list[Codons]:
    """Such as two moves that undo each other."""
    gone = rng.choice(len(items), 2, replace=False) if len(items) > 2 else ()
    return [item for i, item in enumerate(items) if i not in gone]


def _replace(items: list[Codons], make: Make, rng: Rng) -> list[Codons]:
    at = int(rng.integers(len(items)))
    return [*items[:at], make(), *items[at + 1 :]]


def _swap(items: list[Codons], make: Make, rng: Rng) -> list[Codons]:
    i, j = (int(k) for k in rng.integers(len(items), size=2))
    items[i], items[j] = items[j], items[i]
    return items


def _shift(items: list[Codons], make: Make, rng: Rng) -> list[Codons]:
    begin, end = _run(len(items), rng)
    rest = [*items[:begin], *items[end:]]
    at = int(rng.integers(len(rest) + 1))
    return [*rest[:at], *items[begin:end], *rest[at:]]


_STATEMENT_EDITS = (_insert, _copy, _delete, _delete_two, _replace, _swap, _shift)


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
