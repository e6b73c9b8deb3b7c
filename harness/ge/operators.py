"""Selection, crossover and mutation on codons. Pure functions; randomness is an argument, parents are never changed."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.ge.grammar import Grammar
from harness.ge.initialisation import GROW, tree
from harness.ge.mapping import Codons, Derivation, derive


class Parent(NamedTuple):
    """An individual as the operators see it."""

    codons: Codons
    derivation: Derivation

    @property
    def used(self) -> int:
        """Codons that the derivation reads, once around."""
        return min(self.derivation.used, len(self.codons))

    @property
    def has_tree(self) -> bool:
        """Whether every node of a finished tree has codons of its own (wrapping shares them)."""
        return self.derivation.valid and self.derivation.used <= len(self.codons)


def tournament(fitness: NDArray[np.float64], size: int, count: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Indices of ``count`` winners of tournaments among ``size`` individuals drawn with replacement.

    ``fitness`` (individuals,), higher is better, −inf for invalid ones; of equals the first drawn wins.
    """
    drawn = rng.integers(0, len(fitness), (count, size))
    return drawn[np.arange(count), fitness[drawn].argmax(axis=1)]


def one_point(a: Parent, b: Parent, rng: np.random.Generator) -> tuple[Codons, Codons]:
    """Variable-length one-point crossover: each parent is cut at a point of its own within its used codons."""
    i, j = (int(rng.integers(1, max(p.used, 1) + 1)) for p in (a, b))
    return np.concatenate([a.codons[:i], b.codons[j:]]), np.concatenate([b.codons[:j], a.codons[i:]])


def fixed_one_point(a: Parent, b: Parent, rng: np.random.Generator) -> tuple[Codons, Codons]:
    """One-point crossover at the same place of both parents."""
    i = int(rng.integers(1, max(min(a.used, b.used), 1) + 1))
    return np.concatenate([a.codons[:i], b.codons[i:]]), np.concatenate([b.codons[:i], a.codons[i:]])


def subtree_crossover(a: Parent, b: Parent, rng: np.random.Generator) -> tuple[Codons, Codons]:
    """Swap two subtrees that derive from the same non-terminal (Harper and Blair 2005, Whigham 1995).

    In a leftmost derivation a subtree's codons lie together, so that this exchanges two ranges of codons.
    """
    if not (a.has_tree and b.has_tree):
        return a.codons, b.codons
    in_a, in_b = _with_codons(a), _with_codons(b)
    in_a = in_a[np.isin(in_a[:, 0], in_b[:, 0])]
    if not len(in_a):
        return a.codons, b.codons
    rule, i, j = in_a[rng.integers(len(in_a))]
    same = in_b[in_b[:, 0] == rule]
    _, k, m = same[rng.integers(len(same))]
    return (
        np.concatenate([a.codons[:i], b.codons[k:m], a.codons[j:]]),
        np.concatenate([b.codons[:k], a.codons[i:j], b.codons[m:]]),
    )


def per_codon(grammar: Grammar, a: Parent, probability: float, codon_size: int, rng: np.random.Generator) -> Codons:
    """Replace every used codon with a probability by a random one."""
    hit = (rng.random(a.used) < probability).nonzero()[0]
    if not len(hit):
        return a.codons
    codons = a.codons.copy()
    codons[hit] = rng.integers(0, codon_size, len(hit))
    return codons


def per_genome(grammar: Grammar, a: Parent, probability: float, codon_size: int, rng: np.random.Generator) -> Codons:
    """With a probability, replace one used codon by a random one."""
    if not a.used or rng.random() >= probability:
        return a.codons
    codons = a.codons.copy()
    codons[rng.integers(a.used)] = rng.integers(0, codon_size)
    return codons


def subtree_mutation(
    grammar: Grammar, a: Parent, probability: float, codon_size: int, rng: np.random.Generator
) -> Codons:
    """With a probability, replace a subtree by a new one from the same non-terminal, grown a little deeper at most."""
    if not a.has_tree or rng.random() >= probability:
        return a.codons
    return replaced(grammar, a, codon_size, rng)


def structural(grammar: Grammar, a: Parent, probability: float, codon_size: int, rng: np.random.Generator) -> Codons:
    """Edit the derivation tree, again and again as long as chance has it: each time with the given probability.

    An edit replaces a subtree by a new one, or grows or shrinks a list where the grammar has one. At a non-terminal
    <a> with a production like <a> ::= <a> <b>, growing puts a new <b> behind the old <a>; shrinking drops one again.
    What stands before and after keeps its meaning, unlike when a codon is changed.
    """
    while a.has_tree and rng.random() < probability:
        edit = (replaced, _grow_list, _shrink_list)[rng.integers(3)]
        codons = edit(grammar, a, codon_size, rng)
        a = Parent(codons, derive(grammar, codons))
    return a.codons


def replaced(grammar: Grammar, a: Parent, codon_size: int, rng: np.random.Generator) -> Codons:
    """A random subtree is replaced by a small new one."""
    nodes = _with_codons(a)
    if not len(nodes):
        return a.codons
    rule, i, j = nodes[rng.integers(len(nodes))]
    return np.concatenate([a.codons[:i], fresh(grammar, int(rule), codon_size, rng), a.codons[j:]])


def _grow_list(grammar: Grammar, a: Parent, codon_size: int, rng: np.random.Generator) -> Codons:
    """<a> becomes <a> <b> (or <b> <a>), the old <a> within."""
    lists = grammar.lists
    nodes = a.derivation.nodes
    nodes = nodes[np.isin(nodes[:, 0], list(lists))]
    if not len(nodes):
        return a.codons
    rule, i, j = nodes[rng.integers(len(nodes))]
    production = lists[int(rule)][rng.integers(len(lists[int(rule)]))]
    first, last = grammar.arrays.rule_first[rule], grammar.arrays.rule_first[rule + 1]
    parts, old = [np.array([production - first], dtype=np.int32) if last - first > 1 else a.codons[:0]], True
    for symbol in grammar.productions[production].symbols:
        if symbol == rule and old:
            parts.append(a.codons[i:j])
            old = False
        elif symbol >= 0:
            parts.append(fresh(grammar, symbol, codon_size, rng))
    return np.concatenate([a.codons[:i], *parts, a.codons[j:]])


def _shrink_list(grammar: Grammar, a: Parent, codon_size: int, rng: np.random.Generator) -> Codons:
    """A node gives way to the nearest one of its own rule below it."""
    nodes = a.derivation.nodes
    outer = rng.permutation(np.flatnonzero(np.isin(nodes[:, 0], list(grammar.lists))))
    for n in outer:
        rule, i, j = nodes[n]
        inside = nodes[n + 1 :]
        inside = inside[(inside[:, 0] == rule) & (inside[:, 2] <= j) & (inside[:, 1] < j)]
        if len(inside):
            _, k, m = inside[0]
            return np.concatenate([a.codons[:i], a.codons[k:m], a.codons[j:]])
    return a.codons


def fresh(grammar: Grammar, rule: int, codon_size: int, rng: np.random.Generator) -> Codons:
    """Codons of a small new subtree of a rule."""
    depths = grammar.arrays.depth[grammar.arrays.rule_first[rule] : grammar.arrays.rule_first[rule + 1]]
    return tree(grammar, rule, int(depths.min()) + int(rng.integers(_MUTATION_ROOM + 1)), GROW, codon_size, rng)


_MUTATION_ROOM = 3  # levels beyond the least that a new subtree may have


def _with_codons(a: Parent) -> NDArray[np.int32]:
    """Nodes whose subtrees have codons; of a chain of nodes with the same codons only the first."""
    nodes = a.derivation.nodes
    has = nodes[:, 2] > nodes[:, 1]
    has[1:] &= (nodes[1:, 1:] != nodes[:-1, 1:]).any(axis=1)
    return nodes[has]


CROSSOVERS: dict[str, Callable[[Parent, Parent, np.random.Generator], tuple[Codons, Codons]]] = {
    "one-point": one_point,
    "fixed-one-point": fixed_one_point,
    "subtree": subtree_crossover,
}
MUTATIONS: dict[str, Callable[[Grammar, Parent, float, int, np.random.Generator], Codons]] = {
    "per-codon": per_codon,
    "per-genome": per_genome,
    "subtree": subtree_mutation,
    "structural": structural,
}
