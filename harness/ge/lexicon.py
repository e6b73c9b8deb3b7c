"""The statements that edits take from a grammar, rule by rule: its vocabularies, and the statements with blocks."""

from __future__ import annotations

from harness.ge.grammar import Grammar
from harness.ge.mapping import Codons, derive
from harness.ge.operators import Parent
from harness.ge.statements import Listing, Shape, listings, shapes
from harness.ge.vocabulary import Vocabulary
from harness.program import Words


class Lexicon:
    """Remembers what it has been asked for."""

    def __init__(self, grammar: Grammar, words: Words, codon_size: int) -> None:
        """``words``: of the domain whose programs the grammar derives."""
        self.grammar, self.words, self.codon_size = grammar, words, codon_size
        self.shapes = shapes(grammar)
        self._vocabularies: dict[int, Vocabulary] = {}
        self._frames: dict[int, list[Codons]] = {}

    def listings(self, a: Parent) -> list[Listing]:
        """The lists of statements of an individual (:func:`harness.ge.statements.listings`)."""
        return listings(self.shapes, a)

    def vocabulary(self, shape: Shape) -> Vocabulary:
        """Of a list's items."""
        if shape.item not in self._vocabularies:
            self._vocabularies[shape.item] = Vocabulary(self.grammar, self.words, shape.item, self.codon_size)
        return self._vocabularies[shape.item]

    def frames(self, shape: Shape) -> list[Codons]:
        """The statements of the vocabulary that have a block for others of their kind."""
        if shape.rule not in self._frames:
            compound = self.vocabulary(shape).compound
            self._frames[shape.rule] = [item for item in compound if self.blocks(shape, item)]
        return self._frames[shape.rule]

    def blocks(self, shape: Shape, item: Codons) -> list[Listing]:
        """Lists of the same rule within a statement."""
        within = listings(self.shapes, Parent(item, derive(self.grammar, item, start=shape.item)))
        return [each for each in within if each.shape == shape]

    def telling(self, shape: Shape, registers: frozenset[int]) -> list[Codons]:
        """Readings that some registers keep, as statements of their own."""
        plain = self.vocabulary(shape).plain
        return [codons for action, codons in plain.items() if self.words.register[action] in registers]
