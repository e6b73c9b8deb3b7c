"""Lists of statements in a derivation tree, and the codons of a tree whose list is another.

A rule ``<a> ::= <b> | <a> <b>`` (or ``<b> <a>``) is a list of ``<b>``. In a leftmost derivation the codons of each item
lie together, so a list can be taken apart into its items and put together again from any others of the same rule: an
edit of a program is then an edit of its genotype, and is inherited.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.ge.grammar import Grammar
from harness.ge.mapping import Codons
from harness.ge.operators import Parent


class Shape(NamedTuple):
    """How a rule lists its items."""

    rule: int
    item: int
    """Rule of the items."""
    more: int
    """Codon that chooses one more item."""
    last: int
    """Codon that chooses a single one."""
    rest_first: bool
    """Whether the other items stand before the one: ``<a> ::= <a> <b>``."""


class Listing(NamedTuple):
    """A whole list in a derivation tree."""

    shape: Shape
    begin: int
    end: int
    """Its codons are ``begin … end − 1``."""
    items: tuple[Codons, ...]
    """The codons of each item."""


def shapes(grammar: Grammar) -> dict[int, Shape]:
    """The rules that are lists: one alternative with a single rule, and one with that rule and itself."""
    found = {}
    for rule, productions in enumerate(grammar.productions_of):
        used = [[s for s in grammar.productions[i].symbols if s >= 0] for i in productions]
        for last, more in ((0, 1), (1, 0)) if len(used) == 2 else ():
            if len(used[last]) == 1 and sorted(used[more]) == sorted([*used[last], rule]) and used[last] != [rule]:
                found[rule] = Shape(rule, used[last][0], more, last, used[more][0] == rule)
    return found


def listings(known: dict[int, Shape], a: Parent) -> list[Listing]:
    """The whole lists of an individual's tree, those outside before those within; none of a tree that wraps."""
    if not a.has_tree:
        return []
    nodes, found, taken = a.derivation.nodes, [], set[int]()
    for n, rule in enumerate(nodes[:, 0].tolist()):
        if rule in known and n not in taken:
            shape = known[rule]
            chain = _chain(nodes, a.codons, shape, n)
            taken.update(chain)
            found.append(Listing(shape, int(nodes[n, 1]), int(nodes[n, 2]), _items(nodes, a.codons, shape, chain)))
    return found


def put(codons: Codons, listing: Listing, items: Sequence[Codons]) -> Codons:
    """The codons with other items (one at least) in the place of a list."""
    shape, count = listing.shape, len(items)
    heads = [np.array([shape.more], dtype=np.int32)] * (count - 1) + [np.array([shape.last], dtype=np.int32)]
    parts = [*heads, *items] if shape.rest_first else [part for pair in zip(heads, items, strict=True) for part in pair]
    return np.concatenate([codons[: listing.begin], *parts, codons[listing.end :]])


def _chain(nodes: NDArray[np.int32], codons: Codons, shape: Shape, n: int) -> list[int]:
    """The nodes of one list, from the outermost in."""
    chain = [n]
    while codons[nodes[n, 1]] % 2 == shape.more:
        after = nodes[n, 1] if shape.rest_first else nodes[n + 1, 2]  # where the codons of the rest begin
        n += 1
        while nodes[n, 0] != shape.rule or nodes[n, 1] < after:
            n += 1
        chain.append(n)
    return chain


def _items(nodes: NDArray[np.int32], codons: Codons, shape: Shape, chain: list[int]) -> tuple[Codons, ...]:
    if not shape.rest_first:
        return tuple(codons[nodes[n, 1] + 1 : nodes[n + 1, 2]] for n in chain)
    ends = [int(nodes[n, 2]) for n in reversed(chain)]
    begins = [int(nodes[chain[-1], 1]) + 1, *ends[:-1]]
    return tuple(codons[i:j] for i, j in zip(begins, ends, strict=True))
