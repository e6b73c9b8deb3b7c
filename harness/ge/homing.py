"""Statements that lead to one place from anywhere, such as ``while(x() < 3) right() while(x() > 3) left()``.

Where a grammar has them, a stop of a tour needs no way to it, and may stand anywhere in a program, within blocks too.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from harness.ge.mapping import Codons
from harness.ge.moves import Moves
from harness.ge.vocabulary import Vocabulary
from harness.model.tables import STOP, Records, compiled
from harness.program import Program, ProgramError
from harness.program.machine import next_action
from harness.program.words import BELIEF, READING, REGISTER


class Homing:
    """Those of a vocabulary. Remembers what it has been asked for."""

    def __init__(self, vocabulary: Vocabulary, moves: Moves) -> None:
        """Looks through all of the vocabulary once."""
        self._vocabulary, self._moves = vocabulary, moves
        self._starts = sorted({place for start in moves.starts for place in moves.reached(start)})
        self._known: dict[bytes, int] = {}
        self.ways: dict[int, Codons] = {}
        """A statement that leads to a place, the shortest there is; no places in many grammars."""
        for codons in sorted(vocabulary.compound, key=len):
            if (place := self.home(codons)) >= 0:
                self.ways.setdefault(place, codons)

    def home(self, codons: Codons) -> int:
        """Where a statement leads to from anywhere; −1 where that is not one place."""
        key = codons.tobytes()
        if key not in self._known:
            try:
                self._known[key] = home(self._vocabulary.program(codons), self._moves, self._starts)
            except ProgramError:  # a part of a statement
                self._known[key] = -1
        return self._known[key]


def home(program: Program, moves: Moves, starts: Iterable[int]) -> int:
    """Where a program of sure moves ends from every one of ``starts``; −1 where that is not one place, or where it asks
    for what is not visible."""
    code, words = program.code, program.words
    if np.isin(code["op"], (BELIEF, READING, REGISTER)).any():
        return -1
    hidden = len(moves.leads) // words.domain.n_visible
    ends = {_end(code, moves.leads, hidden, words.numbers, words.domain.visible_values, int(v)) for v in starts}
    return ends.pop() if len(ends) == 1 else -1


@compiled
def _end(
    code: Records,
    leads: NDArray[np.int32],
    hidden: int,
    numbers: NDArray[np.float64],
    visible_values: NDArray[np.int16],
    place: int,
) -> int:
    """Where the program ends; −1 where a step is no sure move or stays, or it walks about for ever."""
    marginals, registers = np.zeros((1, 1)), np.zeros((1, 1), dtype=np.int64)
    pc = 0
    for _ in range(len(leads)):
        action, pc = next_action(
            code, 0, len(code), pc, False, marginals, registers, 0, -1, numbers, visible_values, place // hidden
        )
        if action == STOP:
            return place
        to = leads[place, action]
        if to < 0 or to == place:
            return -1
        place = to
    return -1
