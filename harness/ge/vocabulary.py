"""What a grammar's statements do: sampled once, so that edits can take the statement that they need."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from harness.ge.grammar import Grammar
from harness.ge.initialisation import GROW, tree
from harness.ge.mapping import Codons, derive
from harness.program import Program, ProgramError, Words, parse
from harness.program.words import ACT, BELIEF, IF, REGISTER

_SAMPLES = 3_000
"""Statements looked at. The rarest in the shipped grammars, one check among eight beside six other operations and as
many conditions, is met with a probability of 0.99 in a sixth of that."""
_ROOM = 4  # levels beyond the fewest that a sampled statement may have


class Meaning(NamedTuple):
    """What a statement does."""

    action: int
    """Of a single operation, behind one condition at most; −1 for anything else."""
    guarded: bool
    registers: frozenset[int]
    """Readings that its condition asks for."""
    factors: frozenset[int]
    """Hidden factors whose belief it asks for."""
    does: frozenset[int] = frozenset()
    """All actions in it."""

    @property
    def plain(self) -> int:
        """The action of a single unguarded operation; −1 for anything else."""
        return -1 if self.guarded else self.action


_OTHER = Meaning(-1, True, frozenset(), frozenset())


class Vocabulary:
    """The statements that a rule derives, by what they do. Remembers the meanings it has been asked for."""

    def __init__(self, grammar: Grammar, words: Words, rule: int, codon_size: int) -> None:
        """Samples some thousand statements, the same ones always."""
        self.grammar, self.words, self.rule = grammar, words, rule
        self._known: dict[bytes, Meaning] = {}
        self.plain: dict[int, Codons] = {}
        """Codons of a statement that is just an action."""
        self.guarded: dict[int, list[Codons]] = {}
        """Codons of the different statements that are an action behind a condition."""
        self.compound: list[Codons] = []
        """Codons of the other different statements, such as blocks behind a condition."""
        rng, seen = np.random.default_rng(0), set[str]()
        least = int(grammar.arrays.depth[grammar.arrays.rule_first[rule] : grammar.arrays.rule_first[rule + 1]].min())
        for i in range(_SAMPLES):
            codons = tree(grammar, rule, least + i % (_ROOM + 1), GROW, codon_size, rng)
            text = derive(grammar, codons, start=rule).phenotype or ""
            if text not in seen:
                seen.add(text)
                self._sort(codons, self.meaning(codons))

    def _sort(self, codons: Codons, meaning: Meaning) -> None:
        if meaning.plain >= 0:
            self.plain.setdefault(meaning.plain, codons)
        elif meaning.action >= 0:
            self.guarded.setdefault(meaning.action, []).append(codons)
        else:
            self.compound.append(codons)

    def meaning(self, codons: Codons) -> Meaning:
        """What the statement of some codons does."""
        key = codons.tobytes()
        if key not in self._known:
            try:
                self._known[key] = _meaning(self.program(codons))
            except ProgramError:  # a part of a statement
                self._known[key] = _OTHER
        return self._known[key]

    def program(self, codons: Codons) -> Program:
        """A statement as a program of its own.

        Raises:
            ProgramError: it is a part of a statement only.
        """
        return parse(derive(self.grammar, codons, start=self.rule).phenotype or "", self.words)


def _meaning(program: Program) -> Meaning:
    op, arg = program.code["op"], program.code["arg"]
    factor_of = program.words.domain.factor_of
    registers, factors = frozenset(arg[op == REGISTER].tolist()), frozenset(factor_of[arg[op == BELIEF]].tolist())
    simple = op[-1] == ACT and (len(op) == 1 or (op[-2] == IF and (op == ACT).sum() == 1))
    action, guarded = (int(arg[-1]), len(op) > 1) if simple else (-1, True)
    return Meaning(action, guarded, registers, factors, frozenset(arg[op == ACT].tolist()))
