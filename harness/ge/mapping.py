"""Genotype to phenotype: integer codons choose productions by the modulo rule, leftmost non-terminal first.

A rule with a single production takes no codon. When the codons run out they are read again from the first, up to
``max_wraps`` times; an individual whose derivation has not ended then is invalid and has no phenotype. So is one whose
derivation or phenotype is larger than any computer should be asked for: rules that take no codon can double for ever.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.ge.grammar import Grammar, GrammarArrays
from harness.model.tables import compiled

LARGEST_DERIVATION = 2**20
"""Non-terminals, or terminals, of a derivation at most."""
LONGEST_PHENOTYPE = 10_000_000
"""Characters of a phenotype at most."""

Codons = NDArray[np.int32]


class Derivation(NamedTuple):
    """How a genotype maps."""

    phenotype: str | None
    """The derived sentence; None for an invalid individual."""
    used: int
    """Codons read; more than there are after a wrap."""
    depth: int
    """Levels of the derivation tree."""
    nodes: NDArray[np.int32]
    """(non-terminals, 3) of the tree in preorder: rule, first codon, one past the last codon of the subtree."""


def derive(grammar: Grammar, codons: Codons, max_wraps: int = 0, start: int = 0) -> Derivation:
    """Map codons (any number of whole numbers, 0 and up) to a sentence of the grammar, or of one of its rules."""
    room = 8 * len(codons) + 2 * grammar.longest + 128
    while True:
        stack, terminals = np.empty(room, dtype=np.int32), np.empty(room, dtype=np.int32)
        nodes = np.empty((room, 3), dtype=np.int32)
        status, n_terminals, n_nodes, used, depth = _derive(
            grammar.arrays, codons, max_wraps, start, stack, terminals, nodes
        )
        if status != _NO_ROOM or room > LARGEST_DERIVATION:
            break
        room *= 2
    parts = list(map(grammar.terminals.__getitem__, terminals[:n_terminals].tolist()))
    if status != _DONE or sum(map(len, parts)) > LONGEST_PHENOTYPE:
        return Derivation(None, used, depth, nodes[:0])
    return Derivation("".join(parts), used, depth, nodes[:n_nodes].copy())


_DONE, _NO_CODONS, _NO_ROOM = range(3)
_CLOSE = 1 << 24  # above every rule index


@compiled
def _derive(
    g: GrammarArrays,
    codons: Codons,
    max_wraps: int,
    start: int,
    stack: NDArray[np.int32],
    terminals: NDArray[np.int32],
    nodes: NDArray[np.int32],
) -> tuple[int, int, int, int, int]:
    """How it ended, numbers of terminals and nodes, codons used, depth.

    The stack holds symbols still to expand: rules, terminals (~index), and for every expanded node a mark
    (_CLOSE + its number) where its subtree ends. (Arrays are the caller's: Numba pays for growing one in a loop with
    reference counts in every round, which made this six times as slow.)
    """
    rule_first, production_first, symbols = g.rule_first, g.production_first, g.symbols
    limit, size = len(codons) * (max_wraps + 1), len(codons)
    longest = 1
    for i in range(len(production_first) - 1):
        longest = max(longest, production_first[i + 1] - production_first[i])
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
