"""From constants back to codons: which codons spell a number of a phenotype, and which would spell another.

In a leftmost derivation the codons of a subtree lie together, and so do the characters that it derives. The largest
subtrees that lie within a number's characters are its slots; what else stands there is fixed. ``0.<digit><digit>`` has
two slots, and one where a rule ``<decimal>`` derives all of it. The sentences of the slots' rules, found by searching
their small part of the grammar, are the ways to spell a number in that place.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.ge.grammar import Grammar
from harness.ge.mapping import Codons

_MOST = 10_000
"""Sentences of a rule, and spellings of a number, that are looked at: four digits after the point."""
_NUMBER = re.compile(r"\d+(?:\.\d+)?")
_PART = re.compile(r"[\d.]{0,12}")


class Node(NamedTuple):
    """A node of a derivation tree: its codons ``first … last − 1`` and its characters ``begin … end − 1``."""

    rule: int
    first: int
    last: int
    begin: int
    end: int


Choices = tuple[tuple[int, int], ...]
"""(production, number of productions) for each codon of a subtree, from left to right."""


class Place(NamedTuple):
    """A number in a phenotype that codons spell."""

    slots: tuple[Node, ...]
    values: NDArray[np.float64]
    """(n,) the different numbers that can be spelled there, rising."""
    choices: tuple[tuple[Choices, ...], ...]
    """(n, slots) how."""

    def nearest(self, value: float) -> int:
        """Index of the spelling nearest a value; of two equally near ones, the lower."""
        return int(np.abs(self.values - value).argmin())


def nodes(grammar: Grammar, codons: Codons) -> tuple[str, list[Node]]:
    """The phenotype of codons that derive one without wrapping, and its nodes in preorder."""
    found: list[list[int]] = []
    text, used = "", 0
    stack = [0]  # rules, terminals (~index), and marks (rules + a node's number) where a subtree ends
    count = len(grammar.rules)
    first = grammar.arrays.rule_first
    while stack:
        symbol = stack.pop()
        if symbol < 0:
            text += grammar.terminals[~symbol]
        elif symbol >= count:
            found[symbol - count][2::2] = used, len(text)
        else:
            production, n = int(first[symbol]), int(first[symbol + 1] - first[symbol])
            stack.append(count + len(found))
            found.append([symbol, used, 0, len(text), 0])
            if n > 1:
                production += int(codons[used]) % n
                used += 1
            stack.extend(reversed(grammar.productions[production].symbols))
    return text, [Node(*node) for node in found]


class Speller:
    """Spells numbers by a grammar. Remembers the sentences of the rules it has met."""

    def __init__(self, grammar: Grammar, codon_size: int) -> None:
        """``codon_size``: codons are below it."""
        self.grammar, self.codon_size = grammar, codon_size
        self._sentences: dict[int, dict[str, Choices]] = {}

    def places(self, codons: Codons, spans: Sequence[tuple[int, int]]) -> list[Place | None]:
        """How each of the numbers at some characters of the phenotype can be spelled; None where codons spell none.

        ``codons`` must derive a phenotype without wrapping, or their nodes would share them.
        """
        if not spans:
            return []
        text, tree = nodes(self.grammar, codons)
        return [self._place(text, tree, begin, end) for begin, end in spans]

    def _place(self, text: str, tree: list[Node], begin: int, end: int) -> Place | None:
        slots: list[Node] = []
        for node in tree:  # in preorder: a node comes before those inside it
            inside = begin <= node.begin < node.end <= end and node.last > node.first
            if inside and (not slots or node.begin >= slots[-1].end):
                slots.append(node)
        sentences = [self.sentences(slot.rule) for slot in slots]
        if not slots or np.prod([float(len(s)) for s in sentences]) > _MOST:
            return None
        ends = [begin, *(slot.end for slot in slots)]
        fixed = [text[a:b] for a, b in zip(ends, [*(slot.begin for slot in slots), end], strict=True)]
        known: dict[float, tuple[Choices, ...]] = {}
        for parts in itertools.product(*(s.items() for s in sentences)):
            number = fixed[0] + "".join(part + after for (part, _), after in zip(parts, fixed[1:], strict=True))
            if _NUMBER.fullmatch(number) and 0 <= float(number) <= 1:
                known.setdefault(float(number), tuple(choices for _, choices in parts))
        values = sorted(known)
        return Place(tuple(slots), np.array(values), tuple(known[value] for value in values))

    def sentences(self, rule: int) -> dict[str, Choices]:
        """Parts of numbers that a rule derives, and how: by trees of any depth, or of as many levels as give
        10,000 at most."""
        if rule not in self._sentences:
            self._sentences[rule] = self._search(rule)
        return self._sentences[rule]

    def _search(self, rule: int) -> dict[str, Choices]:
        """Trees of one level more in every round, until a round finds nothing new, or too many."""
        found: dict[int, dict[str, Choices]] = {r: {} for r in self._below(rule)}
        while True:
            before = {r: dict(sentences) for r, sentences in found.items()}
            for r in found:
                for text, choices in self._expand(r, before):
                    found[r].setdefault(text, choices)
            if len(found[rule]) > _MOST or all(len(found[r]) == len(before[r]) for r in found):
                return before[rule]

    def _expand(self, rule: int, known: dict[int, dict[str, Choices]]) -> list[tuple[str, Choices]]:
        first, last = self.grammar.arrays.rule_first[rule : rule + 2].tolist()
        made: list[tuple[str, Choices]] = []
        for choice in range(min(last - first, self.codon_size)):
            head: Choices = ((choice, last - first),) if last - first > 1 else ()
            partial = [("", head)]
            for symbol in self.grammar.productions[first + choice].symbols:
                more = [(self.grammar.terminals[~symbol], ())] if symbol < 0 else list(known[symbol].items())
                joined = ((a + b, x + y) for a, x in partial for b, y in more if _PART.fullmatch(a + b))
                partial = list(itertools.islice(joined, 2 * _MOST))
            made += partial
        return made

    def _below(self, rule: int) -> list[int]:
        reached, waiting = [rule], [rule]
        while waiting:
            at = waiting.pop()
            for production in self.grammar.productions:
                if production.rule == at:
                    new = [s for s in production.symbols if s >= 0 and s not in reached]
                    reached += dict.fromkeys(new)
                    waiting += dict.fromkeys(new)
        return reached

    def write(self, codons: Codons, places: Sequence[Place | None], values: Sequence[float]) -> Codons:
        """Codons whose phenotype has other numbers and is else the same: at each place the nearest that it can spell.

        A codon keeps its multiple of the number of productions, so that it changes no more than it must. None leaves a
        number as it is.
        """
        edits = [
            (slot, choices)
            for place, value in zip(places, values, strict=True)
            if place is not None
            for slot, choices in zip(place.slots, place.choices[place.nearest(value)], strict=True)
        ]
        for slot, choices in sorted(edits, reverse=True):  # from the right: what stands before keeps its place
            old = codons[slot.first : slot.last].tolist()
            old += [0] * (len(choices) - len(old))
            new = [self._codon(before, *choice) for before, choice in zip(old, choices, strict=False)]
            codons = np.concatenate([codons[: slot.first], np.array(new, dtype=np.int32), codons[slot.last :]])
        return codons

    def _codon(self, old: int, choice: int, n: int) -> int:
        new = old - old % n + choice
        return new if new < self.codon_size else choice
