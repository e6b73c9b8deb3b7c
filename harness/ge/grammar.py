"""Grammars in Backus-Naur form: the reader, and what mapping and initialisation need to know of a grammar.

The dialect is the one that GE systems share: ``<name> ::= alternative | alternative``, on as many lines as wanted, the
first rule being the start symbol. Terminals stand as they are or in quotes, which are left out; ``#`` begins a comment.
Blanks around an alternative do not count; inside one, any run of blanks and line ends is one blank.

``<const>`` is a real number in [0, 1) that the genotype carries: without a rule of its own it stands for one of a
thousand alternatives, 0.000 to 0.999, which its codon chooses. So it is inherited, mutated and tuned like all else.
"""

from __future__ import annotations

import bisect
import heapq
import itertools
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple, NoReturn

import numpy as np
from numpy.typing import NDArray

from harness import files
from harness.errors import HarnessError, nearest, quoted, short

_NAME = r"<[^<>|\s]+>"
_TOKEN = re.compile(
    rf"(?P<head>{_NAME}\s*::=)|(?P<name>{_NAME})|(?P<bar>\|)|(?P<quoted>\"[^\"\n]*\"|'[^'\n]*')|(?P<comment>#[^\n]*)"
    r"|(?P<blank>\s+)|(?P<wrong>::=|[\"']|<(?=[A-Za-z_]))|(?P<text>[^\s<|\"'#:]+|<|:)"
)


LARGEST_TREE = 10_000
"""Non-terminals of a derivation tree that initialisation and mutation make, at most."""
CONST, CONSTANTS = "<const>", 1000
"""The non-terminal that needs no rule, and how many numbers it stands for: as many as codons are by default."""
MOST_PRODUCTIONS = 10_000
"""Alternatives of a grammar, all rules together."""
ENDLESS = 2**40
"""A size that stands for no end, or for none that a computer sees."""


class GrammarError(HarnessError):
    """A grammar is wrong; the message names the file, the line and the column."""


class Production(NamedTuple):
    """One alternative of a rule."""

    rule: int
    symbols: tuple[int, ...]
    """Rule indices (0 and up) and terminals (``~index``, below 0), from left to right."""
    line: int
    """Of the file, 1-based."""


@dataclass(frozen=True, eq=False)
class Grammar:
    """A context-free grammar. R rules, P productions (alternatives), rule by rule."""

    source: str
    """The file's name, for messages."""
    text: str
    rules: tuple[str, ...]
    """Non-terminals with their angle brackets; the first is the start symbol."""
    terminals: tuple[str, ...]
    productions: tuple[Production, ...]

    @cached_property
    def arrays(self) -> GrammarArrays:
        """The grammar as compiled code takes it."""
        rule_first = np.array([0, *(productions.stop for productions in self.productions_of)])
        lengths = [len(p.symbols) for p in self.productions]
        each = rule_first[:-1]
        return GrammarArrays(
            rule_first.astype(np.int32),
            np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32),
            np.array([s for p in self.productions for s in p.symbols], dtype=np.int32),
            self._depths.astype(np.int32),
            self._recursive,
            self._sizes,
            np.logical_or.reduceat(self._recursive, each),
            np.minimum.reduceat(self._sizes, each),
        )

    @cached_property
    def longest(self) -> int:
        """Symbols of the longest production."""
        return max(len(p.symbols) for p in self.productions)

    @cached_property
    def longest_terminal(self) -> int:
        """Characters of the longest terminal."""
        return max(map(len, self.terminals), default=0)

    @cached_property
    def lists(self) -> dict[int, list[int]]:
        """Of each rule that is a list, such as <a> ::= <b> | <a> <b>: the productions that hold the rule itself."""
        found: dict[int, list[int]] = {}
        for i, p in enumerate(self.productions):
            if p.rule in p.symbols:
                found.setdefault(p.rule, []).append(i)
        return found

    @cached_property
    def productions_of(self) -> tuple[range, ...]:
        """Indices of each rule's productions."""
        first = np.searchsorted([p.rule for p in self.productions], np.arange(len(self.rules) + 1)).tolist()
        return tuple(itertools.starmap(range, itertools.pairwise(first)))

    @cached_property
    def _depths(self) -> NDArray[np.int64]:
        """(P,) fewest levels of a derivation tree under each production."""
        return self._least(lambda below: 1 + max(below, default=0))

    @cached_property
    def _sizes(self) -> NDArray[np.int64]:
        """(P,) fewest non-terminals of a derivation tree under each production, its own rule included."""
        return self._least(lambda below: 1 + sum(below))

    def _least(self, total: Callable[[list[int]], int]) -> NDArray[np.int64]:
        """(P,) least total of a tree under each production; :data:`ENDLESS` where it has no end, or next to none.

        ``total`` of the numbers below must be above each of them: then rules are settled from the least one up, each
        once (Knuth 1977).
        """
        users: list[list[int]] = [[] for _ in self.rules]
        open_symbols, below = [], [[s for s in p.symbols if s >= 0] for p in self.productions]
        for i, symbols in enumerate(below):
            open_symbols.append(len(symbols))
            for s in symbols:
                users[s].append(i)
        found, settled = np.full(len(self.productions), ENDLESS), [ENDLESS] * len(self.rules)
        waiting = [(total([]), i) for i, count in enumerate(open_symbols) if count == 0]
        while waiting:
            least, i = heapq.heappop(waiting)
            found[i] = least
            rule = self.productions[i].rule
            if settled[rule] == ENDLESS:
                settled[rule] = least
                for user in users[rule]:
                    open_symbols[user] -= 1
                    if open_symbols[user] == 0:
                        heapq.heappush(waiting, (min(total([settled[s] for s in below[user]]), ENDLESS), user))
        return found

    @cached_property
    def _recursive(self) -> NDArray[np.bool_]:
        """(P,) whether a production can lead back to its own rule: whether a rule of it lies on a circle with that."""
        from scipy.sparse import csr_array
        from scipy.sparse.csgraph import connected_components

        edges = np.array([(p.rule, s) for p in self.productions for s in p.symbols if s >= 0]).reshape(-1, 2)
        ones, size = np.ones(len(edges), dtype=np.int8), len(self.rules)
        graph = csr_array((ones, (edges[:, 0], edges[:, 1])), shape=(size, size))
        circle = connected_components(graph, connection="strong")[1].tolist()
        return np.array([any(s >= 0 and circle[s] == circle[p.rule] for s in p.symbols) for p in self.productions])


class GrammarArrays(NamedTuple):
    """A grammar for compiled code."""

    rule_first: NDArray[np.int32]
    """(R + 1,) first production of each rule."""
    production_first: NDArray[np.int32]
    """(P + 1,) first symbol of each production."""
    symbols: NDArray[np.int32]
    """Symbols of all productions: rules 0 and up, terminals ``~index``."""
    depth: NDArray[np.int32]
    """(P,) fewest levels of a derivation tree under a production, its own included."""
    recursive: NDArray[np.bool_]
    """(P,) whether a production can lead back to its own rule."""
    size: NDArray[np.int64]
    """(P,) fewest non-terminals of a derivation tree under a production, its own rule included."""
    rule_recursive: NDArray[np.bool_]
    """(R,) whether a rule has a recursive production."""
    rule_size: NDArray[np.int64]
    """(R,) fewest non-terminals of a derivation tree under a rule."""


def read(path: Path) -> Grammar:
    """Read a BNF file.

    Raises:
        GrammarError: the file cannot be read or is no usable grammar.
    """
    return parse(files.read_source(path, GrammarError), str(path))


def parse(text: str, source: str = "grammar") -> Grammar:
    """The grammar that a BNF text defines.

    Raises:
        GrammarError: a stray character, an undefined, unreachable, repeated or endless rule, or too many alternatives;
            with its place.
    """
    return _Reader(text, source).grammar()


class _Symbol(NamedTuple):
    parts: list[str]
    is_rule: bool
    at: int

    @property
    def text(self) -> str:
        return "".join(self.parts)


class _Rule(NamedTuple):
    at: int
    alternatives: list[list[_Symbol]]


class _Reader:
    def __init__(self, text: str, source: str) -> None:
        self.text, self.source = text, source
        self.rules: dict[str, _Rule] = {}
        self.ends = [match.start() for match in re.finditer("\n", text)]

    def fail(self, at: int, why: str) -> NoReturn:
        column = at - self.text.rfind("\n", 0, at)
        raise GrammarError(f"{self.source}, line {self.line(at)}, column {column}: {why}")

    def line(self, at: int) -> int:
        return bisect.bisect_left(self.ends, at) + 1

    def grammar(self) -> Grammar:
        self.read_rules()
        if not self.rules:
            self.fail(len(self.text), "there is no rule; write <code> ::= … first")
        self.add_constants()
        self.check_alternatives()
        self.check_names()
        index = {name: i for i, name in enumerate(self.rules)}
        terminals: dict[str, int] = {}
        productions = []
        for name, rule in self.rules.items():
            for alternative in rule.alternatives:
                symbols = [
                    index[s.text] if s.is_rule else ~terminals.setdefault(s.text, len(terminals)) for s in alternative
                ]
                productions.append(Production(index[name], tuple(symbols), self.line(alternative[0].at)))
        grammar = Grammar(self.source, self.text, tuple(self.rules), tuple(terminals), tuple(productions))
        self.check_ends(grammar)
        return grammar

    def read_rules(self) -> None:
        rule: _Rule | None = None
        blank_before = False
        for match in _TOKEN.finditer(self.text):
            kind, found, at = match.lastgroup, match.group(), match.start()
            if kind in ("comment", "blank"):
                blank_before = True
                continue
            if kind == "wrong":
                self.stray(found, at)
            if kind == "head":
                rule = self.new_rule(found[:-3].rstrip(), at)
            elif rule is None:
                self.fail(at, f"{quoted(found)} stands before the first rule; a rule begins with <name> ::=")
            elif kind == "bar":
                rule.alternatives.append([])
            else:
                self.add_symbol(rule.alternatives[-1], kind or "", found, at, blank_before)
            blank_before = False

    def add_constants(self) -> None:
        """A rule for <const> where it is used and has none."""
        used = [s.at for rule in self.rules.values() for a in rule.alternatives for s in a if s.text == CONST]
        if used and CONST not in self.rules:
            numbers = (f"{i / CONSTANTS:.3f}" for i in range(CONSTANTS))
            self.rules[CONST] = _Rule(used[0], [[_Symbol([number], False, used[0])] for number in numbers])

    def new_rule(self, name: str, at: int) -> _Rule:
        if name in self.rules:
            self.fail(
                at,
                f"{short(name)} is defined in line {self.line(self.rules[name].at)} already; "
                "join the two rules with '|'",
            )
        self.rules[name] = _Rule(at, [[]])
        return self.rules[name]

    def add_symbol(self, alternative: list[_Symbol], kind: str, found: str, at: int, blank_before: bool) -> None:
        text = " " if blank_before and alternative else ""
        if kind != "name":
            text += found[1:-1] if kind == "quoted" else found
        if text and alternative and not alternative[-1].is_rule:
            alternative[-1].parts.append(text)
        elif text or kind == "quoted":
            alternative.append(_Symbol([text], False, at))
        if kind == "name":
            alternative.append(_Symbol([found], True, at))

    def stray(self, found: str, at: int) -> NoReturn:
        if found == "::=":
            self.fail(at, "'::=' without a <name> before it; a rule begins with <name> ::=")
        if found == "<":
            word = self.text[at:].split()[0]
            self.fail(at, f"{quoted(word)} is not closed; write a non-terminal as <name>, or put the sign in quotes")
        self.fail(at, f"the quote {found} is not closed on its line; close it, or put it into quotes of the other kind")

    def check_alternatives(self) -> None:
        count = sum(len(rule.alternatives) for rule in self.rules.values())
        if count > MOST_PRODUCTIONS:
            self.fail(0, f"there are {count:,} alternatives; a grammar has {MOST_PRODUCTIONS:,} at most")
        for name, rule in self.rules.items():
            for alternative in rule.alternatives:
                if not alternative:
                    self.fail(
                        rule.at, f"{short(name)} has an empty alternative; take the '|' away, or write \"\" for nothing"
                    )

    def check_names(self) -> None:
        """Every name that is used is defined, and every rule can be reached from the first."""
        used = {
            name: {s.text: s.at for a in rule.alternatives for s in a if s.is_rule} for name, rule in self.rules.items()
        }
        for names in used.values():
            for name, at in names.items():
                if name not in self.rules:
                    self.fail(
                        at, f"{short(name)} is not defined{nearest(name, self.rules)}; add a rule {short(name)} ::= …"
                    )
        start = next(iter(self.rules))
        reached, waiting = {start}, [start]
        while waiting:
            new = used[waiting.pop()].keys() - reached
            reached |= new
            waiting.extend(new)
        for name, rule in self.rules.items():
            if name not in reached:
                self.fail(
                    rule.at, f"{short(name)} cannot be reached from {short(start)}; use it in a rule, or delete it"
                )

    def check_ends(self, grammar: Grammar) -> None:
        for name, productions in zip(grammar.rules, grammar.productions_of, strict=True):
            least = grammar._sizes[productions.start : productions.stop].min()
            if least > LARGEST_TREE:
                what = "no finite derivation" if least == ENDLESS else f"no derivation of under {LARGEST_TREE:,} rules"
                self.fail(
                    self.rules[name].at, f"{short(name)} has {what}; add an alternative that does not lead back to it"
                )
