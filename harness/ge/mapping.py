"""Genotype to phenotype: integer codons choose productions by the modulo rule, leftmost non-terminal first.

A rule with a single production takes no codon. When the codons run out they are read again from the first, up to
``max_wraps`` times; an individual whose derivation has not ended then is invalid and has no phenotype. So is one whose
derivation or phenotype is larger than any computer should be asked for: rules that take no codon can double for ever.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from harness.ge.grammar import Grammar
from harness.model.tables import compiled

LARGEST_DERIVATION = 2**20
"""Non-terminals, or terminals, of a derivation at most."""
LONGEST_PHENOTYPE = 10_000_000
"""Characters of a phenotype at most."""

Codons = NDArray[np.int32]


class Derivation:
    """How a genotype maps.

    The sentence is put together when it is first asked for: breeding derives many genotypes of which it only needs to
    know how many codons they read.
    """

    __slots__ = ("_terminals", "_text", "_words", "depth", "nodes", "used")

    def __init__(
        self, words: Sequence[str], terminals: NDArray[np.int32] | None, used: int, depth: int, nodes: NDArray[np.int32]
    ) -> None:
        """``terminals``: numbers of the sentence's ``words``; None for an invalid individual."""
        self.used, self.depth, self.nodes = used, depth, nodes
        self._words, self._terminals, self._text = words, terminals, ""

    used: int
    """Codons read; more than there are after a wrap."""
    depth: int
    """Levels of the derivation tree."""
    nodes: NDArray[np.int32]
    """(non-terminals, 3) of the tree in preorder: rule, first codon, one past the last codon of the subtree."""

    @property
    def valid(self) -> bool:
        """Whether it has come to an end."""
        return self._terminals is not None

    @property
    def phenotype(self) -> str | None:
        """The derived sentence; None for an invalid individual."""
        if self._terminals is None:
            return None
        if not self._text:
            self._text = "".join(map(self._words.__getitem__, self._terminals.tolist()))
        return self._text


def derive(grammar: Grammar, codons: Codons, max_wraps: int = 0, start: int = 0) -> Derivation:
    """Map codons (any number of whole numbers, 0 and up) to a sentence of the grammar, or of one of its rules."""
    g, room = grammar.arrays, 4 * min(len(codons), _MOST_USED) + 2 * grammar.longest + 128
    while True:
        made = np.empty((room, 5), dtype=np.int32)
        status, n_terminals, n_nodes, used, depth = _derive(
            g.rule_first, g.production_first, g.symbols, grammar.longest, codons, max_wraps, start, made
        )
        if status != _NO_ROOM or room > LARGEST_DERIVATION:
            break
        room *= 2
    if status != _DONE or _characters(grammar, made[:n_terminals, 1]) > LONGEST_PHENOTYPE:
        return Derivation((), None, used, depth, _NO_NODES)
    kept = made[: max(n_terminals, n_nodes), 1:].copy()
    return Derivation(grammar.terminals, kept[:n_terminals, 0], used, depth, kept[:n_nodes, 1:])


_NO_NODES = np.empty((0, 3), dtype=np.int32)


def _characters(grammar: Grammar, terminals: NDArray[np.int32]) -> int:
    """Of a sentence, at most: counted one by one only where there may be too many."""
    most = len(terminals) * grammar.longest_terminal
    return most if most <= LONGEST_PHENOTYPE else sum(len(grammar.terminals[t]) for t in terminals.tolist())


_DONE, _NO_CODONS, _NO_ROOM = range(3)
_MOST_USED = 256  # codons that most derivations read at most: longer genotypes carry a tail that nothing reads
_CLOSE = 1 << 24  # above every rule index


@compiled
def _derive(
    rule_first: NDArray[np.int32],
    production_first: NDArray[np.int32],
    symbols: NDArray[np.int32],
    longest: int,
    codons: Codons,
    max_wraps: int,
    start: int,
    made: NDArray[np.int32],
) -> tuple[int, int, int, int, int]:
    """How it ended, numbers of terminals and nodes, codons used, depth.

    ``made`` has columns for the stack, the terminals and the nodes. The stack holds symbols still to expand: rules,
    terminals (~index), and for every expanded node a mark (_CLOSE + its number) where its subtree ends. (The array is
    the caller's: Numba pays for growing one in a loop with reference counts in every round, which made this six times
    as slow; and of a grammar only what is read comes in, for every array takes longer to hand over than to read.)
    """
    stack, terminals, nodes = made[:, 0], made[:, 1], made[:, 2:]
    limit, size = len(codons) * (max_wraps + 1), len(codons)
    room = len(stack) - longest - 2  # before what one round may add; derive sees to it that there is some
    stack[0], height = start, 1
    n_terminals, n_nodes, used, depth, open_nodes = 0, 0, 0, 0, 0
    status = _DONE
    while height > 0:
        height -= 1
        symbol = stack[height]
        if symbol >= _CLOSE:
            nodes[symbol - _CLOSE, 2] = used
            open_nodes -= 1
        elif symbol < 0:
            terminals[n_terminals] = ~symbol
            n_terminals += 1
        else:
            production, choices = rule_first[symbol], rule_first[symbol + 1] - rule_first[symbol]
            nodes[n_nodes, 0], nodes[n_nodes, 1] = symbol, used
            if choices > 1:
                if used == limit:
                    status = _NO_CODONS
                    break
                production += codons[used % size] % choices
                used += 1
            first, last = production_first[production], production_first[production + 1]
            stack[height] = _CLOSE + n_nodes
            height += 1
            for i in range(last - 1, first - 1, -1):
                stack[height] = symbols[i]
                height += 1
            n_nodes += 1
            open_nodes += 1
            depth = max(depth, open_nodes)
        if max(height, n_terminals, n_nodes) >= room:
            status = _NO_ROOM
            break
    return status, n_terminals, n_nodes, used, depth
