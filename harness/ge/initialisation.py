"""First populations: derivation trees of bounded depth and size, written down as the codons that choose them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from harness.ge.grammar import LARGEST_TREE, Grammar, GrammarArrays
from harness.ge.mapping import Codons
from harness.model.splitmix import next_uniform
from harness.model.tables import compiled

GROW, FULL, POSITION_INDEPENDENT = range(3)


def ramped(
    grammar: Grammar, size: int, max_depth: int, codon_size: int, tail: float, rng: np.random.Generator
) -> list[Codons]:
    """Ramped half and half: depths rise from the least possible to ``max_depth``; every second tree grows freely, the
    others are full (sensible initialisation, Ryan and Azad 2003)."""
    methods = (GROW, FULL)
    return [
        with_tail(tree(grammar, 0, depth, methods[i % 2], codon_size, rng), tail, codon_size, rng)
        for i, depth in enumerate(_ramp(grammar, size, max_depth))
    ]


def position_independent(
    grammar: Grammar, size: int, max_depth: int, codon_size: int, tail: float, rng: np.random.Generator
) -> list[Codons]:
    """Position-independent grow (Fagan and others 2016): non-terminals are expanded in random order, and the tree
    reaches its depth somewhere; depths are ramped."""
    return [
        with_tail(tree(grammar, 0, depth, POSITION_INDEPENDENT, codon_size, rng), tail, codon_size, rng)
        for depth in _ramp(grammar, size, max_depth)
    ]


def uniform(
    grammar: Grammar, size: int, max_depth: int, codon_size: int, tail: float, rng: np.random.Generator
) -> list[Codons]:
    """Codons drawn at random, ten for every level of ``max_depth``; many such individuals are invalid."""
    return [rng.integers(0, codon_size, 10 * max_depth, dtype=np.int32) for _ in range(size)]


METHODS: dict[str, Callable[..., list[Codons]]] = {
    "ramped": ramped,
    "pi-grow": position_independent,
    "uniform": uniform,
}


def tree(grammar: Grammar, rule: int, max_depth: int, method: int, codon_size: int, rng: np.random.Generator) -> Codons:
    """Codons that derive a random tree from a rule, of at most ``max_depth`` levels (or its least depth, if more).

    A tree has at most :data:`harness.ge.grammar.LARGEST_TREE` non-terminals: where another choice would lead beyond,
    the production with the smallest tree is taken, deeper or not (trees that branch grow by powers of two a level).

    ``method``: GROW takes any production that leaves room to end; FULL prefers recursive ones while there is room;
    POSITION_INDEPENDENT grows, but in random order and so that one branch at least uses all levels it can.
    """
    return _tree(grammar.arrays, rule, max_depth, method, codon_size, rng.integers(0, 2**63, 1).astype(np.uint64))


def with_tail(codons: Codons, tail: float, codon_size: int, rng: np.random.Generator) -> Codons:
    """The codons and as many more, as a share of their number, that no production reads yet: material for variation."""
    extra = rng.integers(0, codon_size, int(np.ceil(tail * len(codons))), dtype=np.int32)
    return np.concatenate([codons, extra])


def _ramp(grammar: Grammar, size: int, max_depth: int) -> list[int]:
    least = int(grammar.arrays.depth[: grammar.arrays.rule_first[1]].min())
    return np.linspace(min(least + 1, max_depth), max_depth, size).round().astype(int).tolist()


@compiled
def _tree(
    g: GrammarArrays, rule: int, max_depth: int, method: int, codon_size: int, state: NDArray[np.uint64]
) -> Codons:
    """Grow the tree in any order, then read the codons off in preorder."""
    rule_first, production_first, symbols = g.rule_first, g.production_first, g.symbols
    can_recur, least = g.rule_recursive, g.rule_size
    nodes = np.empty((64, 4), dtype=np.int32)  # rule, level, codon (−1: none), first child; children lie together
    waiting = np.empty(64, dtype=np.int32)
    nodes[0, 0], nodes[0, 1] = rule, 1
    waiting[0] = 0
    n_nodes, n_waiting, deepest = 1, 1, 1
    spare = max(LARGEST_TREE - least[rule], 0)  # non-terminals beyond the fewest that those waiting need
    recurring = int(can_recur[rule])  # how many of those waiting could still grow deeper
    while n_waiting > 0:
        pick = n_waiting - 1
        if method == POSITION_INDEPENDENT:
            pick = int(next_uniform(state) * n_waiting)
        node = waiting[pick]
        n_waiting -= 1
        waiting[pick] = waiting[n_waiting]
        recurring -= can_recur[nodes[node, 0]]
        level = nodes[node, 1]
        deepest = max(deepest, level)
        first, last = rule_first[nodes[node, 0]], rule_first[nodes[node, 0] + 1]
        deep = method == FULL or (method == POSITION_INDEPENDENT and recurring == 0 and deepest < max_depth)
        allowed = least[nodes[node, 0]] + spare
        production = _choose(g, first, last, max_depth - level + 1, allowed, deep, state)
        spare = allowed - g.size[production]
        n = last - first
        nodes[node, 2] = -1 if n == 1 else production - first + n * int(next_uniform(state) * (codon_size // n))
        nodes[node, 3] = n_nodes
        for i in range(production_first[production], production_first[production + 1]):
            if symbols[i] >= 0:
                if n_nodes == len(nodes):
                    nodes = np.concatenate((nodes, np.empty_like(nodes)))
                if n_waiting == len(waiting):
                    waiting = np.append(waiting, np.empty_like(waiting))
                nodes[n_nodes, 0], nodes[n_nodes, 1] = symbols[i], level + 1
                waiting[n_waiting] = n_nodes
                recurring += can_recur[symbols[i]]
                n_nodes += 1
                n_waiting += 1
    return _preorder(g, nodes, n_nodes)


@compiled
def _choose(
    g: GrammarArrays, first: int, last: int, room: int, allowed: int, deep: bool, state: NDArray[np.uint64]
) -> int:
    """A production of a rule that ends within ``room`` levels and ``allowed`` non-terminals; a recursive one, if it is
    to be deep and there is one. Without room for any, one of the shallowest; if all these are too large, the
    smallest."""
    depth, recursive, size = g.depth, g.recursive, g.size
    room = max(room, depth[first:last].min())
    only_recursive = False
    count = 0
    for p in range(first, last):
        if depth[p] <= room and size[p] <= allowed:
            if deep and recursive[p] and not only_recursive:
                only_recursive, count = True, 0
            if recursive[p] or not only_recursive:
                count += 1
    if count == 0:
        return first + int(size[first:last].argmin())
    pick = int(next_uniform(state) * count)
    for p in range(first, last):
        if depth[p] <= room and size[p] <= allowed and (recursive[p] or not only_recursive):
            if pick == 0:
                return p
            pick -= 1
    return first


@compiled
def _preorder(g: GrammarArrays, nodes: NDArray[np.int32], n_nodes: int) -> Codons:
    rule_first, production_first, symbols = g.rule_first, g.production_first, g.symbols
    codons = np.empty(n_nodes, dtype=np.int32)
    stack = np.empty(n_nodes, dtype=np.int32)
    stack[0], height, n_codons = 0, 1, 0
    while height > 0:
        height -= 1
        node = stack[height]
        rule, codon, child = nodes[node, 0], nodes[node, 2], nodes[node, 3]
        production = rule_first[rule]
        if codon >= 0:
            codons[n_codons] = codon
            n_codons += 1
            production += codon % (rule_first[rule + 1] - rule_first[rule])
        n_children = 0
        for i in range(production_first[production], production_first[production + 1]):
            n_children += symbols[i] >= 0
        for i in range(n_children - 1, -1, -1):
            stack[height] = child + i
            height += 1
    return codons[:n_codons].copy()
