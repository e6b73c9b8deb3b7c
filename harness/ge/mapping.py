"""Genotype to phenotype: integer codons choose productions by the modulo rule, leftmost non-terminal first.

A rule with a single production takes no codon. When the codons run out they are read again from the first, up to
``max_wraps`` times; an individual whose derivation has not ended then is invalid and has no phenotype.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.ge.grammar import Grammar, GrammarArrays
from harness.tables import compiled

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
    terminals, nodes, used, depth, complete = _derive(grammar.arrays, codons, max_wraps, start)
    if not complete:
        return Derivation(None, used, depth, nodes)
    return Derivation("".join([grammar.terminals[t] for t in terminals]), used, depth, nodes)


@compiled
def _derive(
    g: GrammarArrays, codons: Codons, max_wraps: int, start: int
) -> tuple[NDArray[np.int32], NDArray[np.int32], int, int, bool]:
    """Terminals, tree nodes, codons used, depth, and whether the derivation ended.

    The stack holds symbols still to expand: rules, terminals (~index), and for every expanded node a mark
    (_CLOSE + its number) where its subtree ends.
    """
    rule_first, production_first, symbols = g.rule_first, g.production_first, g.symbols
    limit = len(codons) * (max_wraps + 1)
    stack = np.empty(64, dtype=np.int32)
    terminals = np.empty(256, dtype=np.int32)
    nodes = np.empty((256, 3), dtype=np.int32)
    stack[0], height = start, 1
    n_terminals, n_nodes, used, depth, open_nodes = 0, 0, 0, 0, 0
    while height > 0:
        height -= 1
        symbol = stack[height]
        if symbol >= _CLOSE:
            nodes[symbol - _CLOSE, 2] = used
            open_nodes -= 1
        elif symbol < 0:
            if n_terminals == len(terminals):
                terminals = np.append(terminals, np.empty_like(terminals))
            terminals[n_terminals] = ~symbol
            n_terminals += 1
        else:
            production, choices = rule_first[symbol], rule_first[symbol + 1] - rule_first[symbol]
            if n_nodes == len(nodes):
                nodes = np.concatenate((nodes, np.empty_like(nodes)))
            nodes[n_nodes, 0], nodes[n_nodes, 1] = symbol, used
            if choices > 1:
                if used == limit:
                    return terminals[:0], nodes[:0], used, depth, False
                production += codons[used % len(codons)] % choices
                used += 1
            first, last = production_first[production], production_first[production + 1]
            while height + last - first + 1 > len(stack):
                stack = np.append(stack, np.empty_like(stack))
            stack[height] = _CLOSE + n_nodes
            height += 1
            for i in range(last - 1, first - 1, -1):
                stack[height] = symbols[i]
                height += 1
            n_nodes += 1
            open_nodes += 1
            depth = max(depth, open_nodes)
    return terminals[:n_terminals], nodes[:n_nodes], used, depth, True


_CLOSE = 1 << 24  # above every rule index
