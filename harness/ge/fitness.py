"""The fitness of programs on a domain: mean undiscounted return, less a penalty for length (paper, section 4.1)."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.engine import rng
from harness.errors import quoted
from harness.expectation.forward import exact
from harness.expectation.programs import expected
from harness.ge.grammar import Grammar, GrammarError
from harness.ge.hall import Hall
from harness.ge.initialisation import GROW, tree
from harness.ge.loop import Evaluated, rows_of
from harness.ge.mapping import derive
from harness.ge.parameters import AUTO, DISCOUNTED, SAMPLED, Parameters
from harness.model.domain import Domain
from harness.play import population
from harness.play.evaluation import mean_and_sem
from harness.play.population import Episodes
from harness.policy.team import policy_of
from harness.program import NestingError, Program, ProgramError, Words, parse, words_of

_MOST_CHECKED = 1_000_000  # characters parsed, and rules derived, to see whether a grammar speaks the language
_MOST_AROUND = 16_000_000  # characters kept of what stands around the rules


ROOM = 100_000
"""Situations of one step that a program's exact return may take (:func:`harness.expectation.programs.expected`)."""
_AUTO = 2
"""With ``auto``, situations of one step for each episode of a generation: about what playing would take."""


class Judged(NamedTuple):
    """What is known of the returns of P programs."""

    means: NDArray[np.float64]
    returns: Sequence[NDArray[np.float64]]
    """Those that each mean is of; a single one where it is exact, or a bound."""
    behaviours: int
    """How many of them earn differently, in some episode or in expectation."""
    cost: int
    """Environment steps played and situations expanded."""
    descriptors: NDArray[np.float64] | None = None
    """(P, 3) different visible values seen, readings made and steps taken in an episode, each as a share of the most
    that there can be; None where not all have been played."""

    def only(self, programs: list[int]) -> Judged:
        """What is known of some of them; it has been paid for."""
        returns = [self.returns[i] for i in programs]
        return Judged(self.means[programs], returns, self.behaviours, 0)

    @property
    def sems(self) -> list[float]:
        """Standard errors of the means."""
        return [mean_and_sem(row)[1] if len(row) > 1 else 0.0 for row in self.returns]


class ProgramFitness:
    """Fitness of program texts; each generation has episodes of its own, the same for all its programs."""

    def __init__(self, domain: Domain, parameters: Parameters, engine: str, workers: int) -> None:
        """``engine``: ``tables`` or ``julia``; ``workers``: threads of the tables engine."""
        self.domain = domain.shaped(parameters.shaping)
        self.words = words_of(domain)
        self.parameters, self.engine, self.workers = parameters, engine, workers
        self.hall: Hall | None = None
        """Sees what every generation has judged."""
        self.discount = domain.discount if parameters.objective == DISCOUNTED else 1.0
        """Of the return that counts."""
        self._known: dict[str, Program] = {}  # those judged last: many a phenotype comes again

    def __call__(self, phenotypes: Sequence[str], generation: int) -> Evaluated:
        """Fitness on the episodes of a generation; −inf for a program that is nested too deep to be compiled."""
        return self._evaluated(phenotypes, generation, self.parameters.breeds_by_play)

    def alone(self, phenotypes: Sequence[str], generation: int) -> Evaluated:
        """The same without what only breeding needs: for programs that do not breed yet."""
        return self._evaluated(phenotypes, generation, False)

    def _evaluated(self, phenotypes: Sequence[str], generation: int, also_played: bool) -> Evaluated:
        p = self.parameters
        compiled = [self._compiled(text) for text in phenotypes]
        programs = [program for program in compiled if program is not None]
        self._known = {text: program for text, program in zip(phenotypes, compiled, strict=True) if program is not None}
        first = generation * p.episodes
        if also_played:
            played = self._judged(self.play(programs, first, p.episodes))
            exactly = self._exactly(programs, played.only)
            judged = played._replace(means=exactly.means, cost=exactly.cost + played.cost)
        else:
            judged = self.judge(programs, first, p.episodes)
        if self.hall:
            self.hall.see(generation, programs, judged.means)
        known = np.array([program is not None for program in compiled], dtype=np.bool_)
        at = np.where(known, np.cumsum(known) - 1, -1)
        cased = p.uses_cases and (also_played or p.fitness == SAMPLED)
        returns = np.reshape(judged.returns, (len(programs), p.episodes)) if cased else None
        return Evaluated(
            rows_of(self.penalized(programs, judged.means), at),
            judged.behaviours,
            judged.cost,
            None if returns is None else rows_of(self.penalized(programs, returns), at),
            rows_of(judged.descriptors, at),
        )

    def _compiled(self, text: str) -> Program | None:
        try:
            return self.compile(text)
        except NestingError:
            return None

    def compile(self, text: str) -> Program:
        """The program of a phenotype."""
        known = self._known.get(text)
        return known or parse(text, self.words, loop=self.parameters.loop, source="phenotype")

    def judge(self, programs: Sequence[Program], first: int, count: int) -> Judged:
        """The programs' returns as the run's ``fitness`` has them: exact, or on episodes of the search."""
        if self.parameters.fitness == SAMPLED:
            return self._judged(self.play(programs, first, count))
        return self._exactly(programs, lambda wide: self._judged(self.play([programs[i] for i in wide], first, count)))

    def _exactly(self, programs: Sequence[Program], sampled: Callable[[list[int]], Judged]) -> Judged:
        """Exact returns; with too many situations, what episodes say (``auto``: ``sampled``, of the programs with these
        indices), or the least that is sure."""
        auto, horizon = self.parameters.fitness == AUTO, self.parameters.horizon
        room = _AUTO * self.parameters.episodes if auto else ROOM
        found = expected(self.domain, programs, horizon, room, self.workers, self.discount)
        means, cost = found.returns, int(found.situations.sum())
        returns = [means[i : i + 1] for i in range(len(means))]
        wide = np.flatnonzero(np.isnan(means)).tolist()
        if auto and len(wide):
            played = sampled(wide)
            means[wide], cost = played.means, cost + played.cost
            for i, row in zip(wide, played.returns, strict=True):
                returns[i] = row
        for i in wide if not auto else ():
            bounded = exact(self.domain, policy_of(programs[i]), horizon=horizon)
            objective = bounded.mean if self.discount == 1 else bounded.discounted
            means[i], cost = objective.low, cost + bounded.situations
        return Judged(means, returns, len(set(means.tolist())), cost)

    def play(self, programs: Sequence[Program], first: int, count: int) -> population.Played:
        """The programs in the episodes of the search from number ``first`` on."""
        p = self.parameters
        return self.play_on(programs, Episodes(rng.TRAINING + p.seed, first, count, p.horizon))

    def play_on(self, programs: Sequence[Program], episodes: Episodes) -> population.Played:
        """The programs in any episodes, under the shaping of the search."""
        return population.play(self.domain, programs, episodes, self.engine, self.workers, self.discount)

    def penalized(self, programs: Sequence[Program], returns: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns of P programs, (P,) means or (P, E), − penalty·max(0, length − free length) of each program."""
        p = self.parameters
        excess = np.array([max(0, program.length - p.free_length) for program in programs])
        return (returns.T - p.penalty * excess).T if len(excess) else returns

    def _judged(self, played: population.Played) -> Judged:
        returns = played.returns
        behaviours = len({row.tobytes() for row in returns})  # np.unique turns Ctrl-C into a TypeError
        horizon = self.parameters.horizon
        most = np.array([min(self.domain.n_visible, horizon + 1), horizon, horizon]) * max(1, returns.shape[1])
        descriptors = np.stack([played.visited, played.readings, played.steps], axis=1) / most
        return Judged(returns.mean(axis=1), list(returns), behaviours, int(played.steps.sum()), descriptors)


def check_language(grammar: Grammar, words: Words) -> None:
    """Make sure that the grammar's sentences are programs: a few for each of its productions are parsed.

    Of a grammar whose sentences are very long, or of very many rules, as many as have a million characters and
    derivations of a million rules together.

    Raises:
        GrammarError: one is not; the message names the production's line.
    """
    speller = _Speller(grammar)
    least = grammar.arrays.depth
    deepest = int(least.max())
    simple_first = np.argsort(least, kind="stable").tolist()  # so that the message names the production at fault
    for depth in (1, deepest + 2, deepest + 6):
        around = _surroundings(grammar, depth, speller)
        for number in simple_first:
            production = grammar.productions[number]
            if production.rule not in around:
                continue
            before, after = around[production.rule]
            text = before + speller.spell(production.symbols, depth) + after
            speller.left -= len(text)
            if speller.left < 0:
                return
            try:
                parse(text, words, source="a sentence of it")
            except ProgramError as error:
                raise GrammarError(
                    f"{grammar.source}, line {production.line}: a sentence of the grammar, "
                    f"{quoted(text)}, is no program of {words.domain.name} ({error})"
                ) from None


def _surroundings(grammar: Grammar, depth: int, speller: _Speller) -> dict[int, tuple[str, str]]:
    """Of each rule, what stands before and after it in a sentence: the productions on a shortest way from the start
    symbol, written out at random off the way. Rules far from the start may be missing, where all that is too long."""
    around = {0: ("", "")}
    waiting = deque([0])
    size = 0
    while waiting:
        rule = waiting.popleft()
        before, after = around[rule]
        for i in grammar.productions_of[rule]:
            symbols = grammar.productions[i].symbols
            for at, symbol in enumerate(symbols):
                if symbol >= 0 and symbol not in around and size < _MOST_AROUND:
                    left, right = (speller.spell(part, depth) for part in (symbols[:at], symbols[at + 1 :]))
                    around[symbol] = before + left, right + after
                    size += len(before + left + right + after)
                    waiting.append(symbol)
    return around


class _Speller:
    """Writes out symbols of a grammar."""

    def __init__(self, grammar: Grammar) -> None:
        self.grammar = grammar
        self.left = _MOST_CHECKED
        self._generator = np.random.default_rng(0)
        self._only = _only_sentences(grammar)

    def spell(self, symbols: tuple[int, ...], depth: int) -> str:
        """Terminals as they are; for each rule its only sentence, or that of a random tree."""
        return "".join(self.grammar.terminals[~s] if s < 0 else self._sentence(s, depth) for s in symbols)

    def _sentence(self, rule: int, depth: int) -> str:
        if rule in self._only:
            return self._only[rule]
        if self.left < 0:
            return ""
        codons = tree(self.grammar, rule, depth, GROW, 1000, self._generator)
        derived = derive(self.grammar, codons, start=rule)
        self.left -= len(derived.nodes)
        return derived.phenotype or ""


def _only_sentences(grammar: Grammar) -> dict[int, str]:
    """The sentences of rules that have a single one each; not of all, where they are very long.

    Each is put together from those of smaller rules: deriving them one by one takes, of a chain of rules, the square
    of its length.
    """
    found: dict[int, str] = {}
    size = 0
    for rule in np.argsort(grammar.arrays.rule_size, kind="stable").tolist():
        symbols = grammar.productions[grammar.productions_of[rule].start].symbols
        if len(grammar.productions_of[rule]) > 1 or not all(s < 0 or s in found for s in symbols):
            continue
        parts = [grammar.terminals[~s] if s < 0 else found[s] for s in symbols]
        size += sum(map(len, parts)) if len(parts) > 1 else 0
        if size <= _MOST_CHECKED:
            found[rule] = "".join(parts)
    return found
