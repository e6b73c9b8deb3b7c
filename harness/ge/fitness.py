"""The fitness of programs on a domain: mean undiscounted return, less a penalty for length (paper, section 4.1)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from harness.engine import rng
from harness.errors import quoted
from harness.ge.grammar import Grammar, GrammarError
from harness.ge.initialisation import GROW, tree
from harness.ge.loop import Evaluated
from harness.ge.mapping import derive
from harness.ge.parameters import Parameters
from harness.model.domain import Domain
from harness.play import population
from harness.play.population import Episodes
from harness.program import NestingError, Program, ProgramError, Words, parse, words_of


class ProgramFitness:
    """Fitness of program texts; each generation has episodes of its own, the same for all its programs."""

    def __init__(self, domain: Domain, parameters: Parameters, engine: str, workers: int) -> None:
        """``engine``: ``tables`` or ``julia``; ``workers``: threads of the tables engine."""
        self.domain = domain.shaped(parameters.shaping)
        self.words = words_of(domain)
        self.parameters, self.engine, self.workers = parameters, engine, workers

    def __call__(self, phenotypes: Sequence[str], generation: int) -> Evaluated:
        """Fitness on the episodes of a generation; −inf for a program that is nested too deep to be compiled."""
        p = self.parameters
        compiled = [self._compiled(text) for text in phenotypes]
        programs = [program for program in compiled if program is not None]
        played = self.play(programs, generation * p.episodes, p.episodes)
        scores = np.full(len(compiled), -np.inf)
        scores[[program is not None for program in compiled]] = self.penalized(programs, played.returns)
        behaviours = len({row.tobytes() for row in played.returns})  # np.unique turns Ctrl-C into a TypeError
        return Evaluated(scores, behaviours, int(played.steps.sum()))

    def _compiled(self, text: str) -> Program | None:
        try:
            return self.compile(text)
        except NestingError:
            return None

    def compile(self, text: str) -> Program:
        """The program of a phenotype."""
        return parse(text, self.words, loop=self.parameters.loop, source="phenotype")

    def play(self, programs: Sequence[Program], first: int, count: int) -> population.Played:
        """The programs in the episodes of the search from number ``first`` on."""
        p = self.parameters
        return self.play_on(programs, Episodes(rng.TRAINING + p.seed, first, count, p.horizon))

    def play_on(self, programs: Sequence[Program], episodes: Episodes) -> population.Played:
        """The programs in any episodes, under the shaping of the search."""
        return population.play(self.domain, programs, episodes, self.engine, self.workers)

    def penalized(self, programs: Sequence[Program], returns: NDArray[np.float64]) -> NDArray[np.float64]:
        """Mean return − penalty·max(0, length − free length) of each program; ``returns``: (programs, episodes)."""
        p = self.parameters
        excess = np.array([max(0, program.length - p.free_length) for program in programs])
        return returns.mean(axis=1) - p.penalty * excess if len(excess) else np.zeros(0)


def check_language(grammar: Grammar, words: Words) -> None:
    """Make sure that the grammar's sentences are programs: a few for each of its productions are parsed.

    Raises:
        GrammarError: one is not; the message names the production's line.
    """
    generator = np.random.default_rng(0)
    least = grammar.arrays.depth
    deepest = int(least.max())
    simple_first = np.argsort(least, kind="stable").tolist()  # so that the message names the production at fault
    for depth in (1, deepest + 2, deepest + 6):
        for number in simple_first:
            text = _expand(grammar, 0, _way_to(grammar, number), depth, generator)
            try:
                parse(text, words, source="a sentence of it")
            except ProgramError as error:
                raise GrammarError(
                    f"{grammar.source}, line {grammar.productions[number].line}: a sentence of the grammar, "
                    f"{quoted(text)}, is no program of {words.domain.name} ({error})"
                ) from None


def _way_to(grammar: Grammar, production: int) -> list[int]:
    """Productions on a shortest way from the start symbol to a production, which is the last."""
    ways: dict[int, list[int]] = {0: []}
    waiting = [0]
    target = grammar.productions[production].rule
    while target not in ways:
        rule = waiting.pop(0)
        for i, p in enumerate(grammar.productions):
            if p.rule == rule:
                for symbol in p.symbols:
                    if symbol >= 0 and symbol not in ways:
                        ways[symbol] = [*ways[rule], i]
                        waiting.append(symbol)
    return [*ways[target], production]


def _expand(grammar: Grammar, rule: int, way: list[int], depth: int, generator: np.random.Generator) -> str:
    """The sentence of a rule along a way of productions; random off the way."""
    if not way:
        codons = tree(grammar, rule, depth, GROW, 1000, generator)
        return derive(grammar, codons, start=rule).phenotype or ""
    production, rest = grammar.productions[way[0]], way[1:]
    goal = grammar.productions[rest[0]].rule if rest else -1
    text, on_way = "", True
    for symbol in production.symbols:
        if symbol < 0:
            text += grammar.terminals[~symbol]
        elif on_way and symbol == goal:
            text, on_way = text + _expand(grammar, symbol, rest, depth, generator), False
        else:
            text += _expand(grammar, symbol, [], depth, generator)
    return text
