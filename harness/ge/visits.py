"""What edits put into a program for something to be done at a place: the acts, the reading and the condition before."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np

from harness.ge.homing import Homing
from harness.ge.lexicon import Lexicon
from harness.ge.mapping import Codons
from harness.ge.moves import Moves, Pay
from harness.ge.statements import Shape, put
from harness.ge.tour import Stop

_T = TypeVar("_T")
Rng = np.random.Generator

_PAYING = 0.75
"""Of the visits with ``paying``: share of those to where something pays; the others lead anywhere."""
_GUARDED, _INFORMED = 0.75, 0.75
"""Share of the acts that stand behind a condition; of these, share that first make the reading asked for."""
_RELEVANT = 0.75
"""Of the acts behind a condition: share whose condition asks for what the tables say that the act depends on."""
_FRAMED = 0.5
"""Share of the visits that are made, the way included, behind a condition only."""
_READINGS = 3
"""Of the thing that such a condition asks for there are fewer readings than this before it."""


class Visits:
    """Makes stops of tours and whole visits. Remembers what it has found in a grammar."""

    def __init__(self, lexicon: Lexicon, moves: Moves, paying: bool) -> None:
        """``paying``: whether most visits lead to where the tables say that an action can pay."""
        self.lexicon, self.moves = lexicon, moves
        self._pays = moves.pays if paying else []
        self._register = lexicon.words.register
        self._tells = {a: int(moves.factor[:, a].max()) for a in np.flatnonzero(self._register >= 0).tolist()}
        self._read_by = {int(self._register[a]): factor for a, factor in self._tells.items()}
        self._acting: dict[tuple[int, int, int], list[Codons]] = {}
        self._homing: dict[int, Homing] = {}
        self._frames: dict[tuple[int, int], list[Codons]] = {}

    def homing(self, shape: Shape) -> Homing:
        """Of the items of a list."""
        if shape.item not in self._homing:
            self._homing[shape.item] = Homing(self.lexicon.vocabulary(shape), self.moves)
        return self._homing[shape.item]

    def stop(self, shape: Shape, origin: int, rng: Rng) -> Stop | None:
        """A new stop of a tour that can be reached from a place, and what is done there."""
        what = self._pay(self._pays, rng) or self._anything(one(self.moves.reached(origin), rng), rng)
        acts = self._acts(shape, what, rng) if what else []
        return Stop(what.place, None, tuple(acts)) if what and acts else None

    def visit(self, shape: Shape, rng: Rng) -> list[Codons]:
        """Statements that go to a place from anywhere and do something, only behind a condition perhaps."""
        ways = self.homing(shape).ways
        what = self._pay([pay for pay in self._pays if pay.place in ways], rng)
        return [ways[one(list(ways), rng)]] if what is None else self._visit_for(shape, what, rng)

    def anew(self, shape: Shape, part: Sequence[Codons], rng: Rng) -> Sequence[Codons]:
        """Another visit in the place of one to where something pays; any other as it is."""
        place = self._leads(shape, part)
        pays = [pay for pay in self._pays if pay.place == place]
        return self._visit_for(shape, one(pays, rng), rng) if pays else part

    def _leads(self, shape: Shape, items: Sequence[Codons]) -> int:
        """Where the first of some statements leads to that leads anywhere, by itself or within its blocks; −1 if none
        does."""
        homing = self.homing(shape)
        for item in items:
            if (place := homing.home(item)) in homing.ways:
                return place
            for block in self.lexicon.blocks(shape, item):
                if (place := self._leads(shape, block.items)) >= 0:
                    return place
        return -1

    def _visit_for(self, shape: Shape, what: Pay, rng: Rng) -> list[Codons]:
        items = [self.homing(shape).ways[what.place], *self._acts(shape, what, rng)]
        return self._framed(shape, what, items, rng) if rng.random() < _FRAMED else items

    def parts(self, shape: Shape, items: Sequence[Codons]) -> list[tuple[Codons, ...]]:
        """A list of statements, visit by visit: each begins where something unconditional follows a condition."""
        meaning, home = self.lexicon.vocabulary(shape).meaning, self.homing(shape).home
        parts, open_part = list[list[Codons]](), False
        for item in items:
            sure = meaning(item).plain >= 0 or home(item) >= 0
            if not parts or (sure and not open_part):
                parts.append([])
            parts[-1].append(item)
            open_part = sure
        return [tuple(part) for part in parts]

    def _pay(self, pays: Sequence[Pay], rng: Rng) -> Pay | None:
        return one(pays, rng) if pays and rng.random() < _PAYING else None

    def _anything(self, place: int, rng: Rng) -> Pay | None:
        """Any action that does not lead away from a place."""
        staying = np.flatnonzero(self.moves.leads[place] == place).tolist()
        return Pay(place, one(staying, rng)) if staying else None

    def _acts(self, shape: Shape, what: Pay, rng: Rng) -> list[Codons]:
        """Statements that end in an action: behind a condition perhaps, and after a reading that tells of it."""
        vocabulary = self.lexicon.vocabulary(shape)
        relevant, guarded = self._doing(shape, what), vocabulary.guarded.get(what.action, [])
        if not (relevant or guarded) or rng.random() >= _GUARDED:
            plain = vocabulary.plain.get(what.action)
            return [] if plain is None else [plain]
        act = one(relevant if relevant and (not guarded or rng.random() < _RELEVANT) else guarded, rng)
        asked = vocabulary.meaning(act)
        telling = [
            codons
            for action, codons in vocabulary.plain.items()
            if self.moves.leads[what.place, action] == what.place
            and (self._register[action] in asked.registers or self.moves.factor[what.place, action] in asked.factors)
        ]
        return [one(telling, rng), act] if telling and rng.random() < _INFORMED else [act]

    def _doing(self, shape: Shape, what: Pay) -> list[Codons]:
        """The statements that stay at a place for an action, behind conditions on what it depends on."""
        if (key := (shape.rule, *what)) not in self._acting:
            vocabulary = self.lexicon.vocabulary(shape)
            factor, staying = int(self.moves.factor[what]), self.moves.leads[what.place] == what.place
            self._acting[key] = [
                item
                for item in [*vocabulary.guarded.get(what.action, []), *vocabulary.compound]
                if what.action in (does := vocabulary.meaning(item).does)
                and all(staying[action] or action == what.action for action in does)
                and self._asked(shape, item) == {factor}
            ]
        return self._acting[key]

    def _asked(self, shape: Shape, item: Codons) -> set[int]:
        """The hidden factors that a statement's conditions ask for, by the belief or by a reading."""
        meaning = self.lexicon.vocabulary(shape).meaning(item)
        return {*meaning.factors, *(self._read_by[register] for register in meaning.registers)}

    def _framed(self, shape: Shape, what: Pay, items: list[Codons], rng: Rng) -> list[Codons]:
        """The statements in the block of a condition on what the action depends on, after readings of that."""
        factor = int(self.moves.factor[what.place, what.action])
        frames = self._about(shape, factor)
        if not frames:
            return items
        frame, plain = one(frames, rng), self.lexicon.vocabulary(shape).plain
        telling = [codons for action, codons in plain.items() if self._tells.get(action) == factor]
        readings = [one(telling, rng) for _ in range(int(rng.integers(_READINGS))) if telling]
        return [*readings, put(frame, one(self.lexicon.blocks(shape, frame), rng), items)]

    def _about(self, shape: Shape, factor: int) -> list[Codons]:
        """The statements with a block whose conditions ask for one factor, and for nothing else that is hidden."""
        if (key := (shape.rule, factor)) not in self._frames:
            frames = self.lexicon.frames(shape)
            self._frames[key] = [frame for frame in frames if self._asked(shape, frame) == {factor}]
        return self._frames[key]


def one(of: Sequence[_T], rng: Rng) -> _T:
    """One of some, drawn at random."""
    return of[int(rng.integers(len(of)))]
