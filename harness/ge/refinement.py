"""The hybrid of the paper's future work: evolution finds a program, a search over its constants improves it.

Individuals learn in the course of a run (:class:`Refiner`), or the best programs at its end (:func:`rivals`). What an
individual has learnt it is judged by (Baldwin), or it passes it on as well (Lamarck): the constants are written back
into its codons.

What it is worth depends on what the constants decide. On rocksample-7x8 a reading is right with at least 0.87 from any
cell, so that every constant from 0.13 to 0.87 decides alike after one reading, and selection sees to the rest: over ten
seeds (150 generations; tournament 5, subtree operators) the difference to plain evolution at equal numbers of steps was
−0.03 ± 0.02 with ``refine=5``, and with ``refine_every=10`` too −0.98 ± 0.57 (Lamarck) and −0.10 ± 0.78 (Baldwin).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.engine import rng
from harness.expectation.smooth.forward import forward
from harness.ge.fitness import ProgramFitness
from harness.ge.grammar import Grammar, GrammarError
from harness.ge.initialisation import GROW, tree
from harness.ge.loop import Learnt
from harness.ge.mapping import derive
from harness.ge.operators import Parent
from harness.ge.parameters import LAMARCKIAN, LINES
from harness.ge.spelling import Place, Speller
from harness.play.population import Episodes
from harness.program import Program, Words, constant_spans, parse
from harness.tuning.autodiff import Autodiff
from harness.tuning.constants import Constants, Vector
from harness.tuning.journal import Journal
from harness.tuning.lines import Lines
from harness.tuning.method import Ask, Method
from harness.tuning.run import climb

COARSE, ROUNDS = 2, 1
"""Settings of the search: the ends and the middle of every constant's range first, and each constant once. More of
either costs steps and found nothing more in evolved programs, whose constants seldom matter to one another."""

SHORT: dict[str, Any] = {"iterations": 12, "cooling": 0.75, "decay": 20.0, "situations": 500}
"""Settings of the ascent: a whole one, but few steps and few situations."""

_SAMPLES = 300  # sentences that tell whether a grammar has constants


@dataclass
class _Counted:
    """The objective of one search: mean return on the refinement's episodes; counts what it costs."""

    fitness: ProgramFitness
    subject: Constants
    first: int
    steps: int = 0

    def __call__(self, ask: Ask) -> NDArray[np.float64]:
        """(n, episodes) returns."""
        p = self.fitness.parameters
        programs = [self.subject.at(point) for point in ask.points]
        episodes = Episodes(rng.REFINEMENT + p.seed, self.first, ask.episodes, p.horizon)
        played = self.fitness.play_on(programs, episodes)
        self.steps += int(played.steps.sum())
        return played.returns

    def smooth(self, ask: Ask) -> Vector:
        """(1 + d,) the smooth return and its gradient; a situation counts as a step."""
        assert ask.soft is not None
        p, policy = self.fitness.parameters, self.subject.policy(ask.points[0])
        draws = rng.generator(rng.REFINEMENT + p.seed, rng.TUNER, self.first + int(ask.first[0]))
        found = forward(
            self.fitness.domain, policy, ask.soft.temperature, p.horizon, ask.soft.situations, draws
        )  # fmt: skip
        self.steps += found.situations
        return np.append(found.value, found.gradient)


@dataclass(frozen=True, eq=False)
class _Spelled(Constants):
    """Constants that codons must be able to spell: each stands for the nearest that can be."""

    places: Sequence[Place | None] = ()

    def at(self, theta: Vector) -> Program:
        """The program with the spelled constants nearest ``theta``; those that no codons spell stay as they are."""
        values = [
            own if place is None else place.values[place.nearest(x)]
            for own, place, x in zip(self.program.constants, self.places, theta, strict=True)
        ]
        return self.program.with_constants(np.array(values))


def tuned(fitness: ProgramFitness, subject: Constants, generation: int) -> tuple[Program, int]:
    """The program with better constants for the refinement's episodes of a generation, and the steps that it cost.

    The search is :class:`harness.tuning.lines.Lines`, for the return is a step function of every constant with few
    steps, or :class:`harness.tuning.autodiff.Autodiff` on the smooth return. Where the latter ends is taken only if it
    is better than the start on the refinement's episodes.
    """
    p = fitness.parameters
    played = _Counted(fitness, subject, generation * p.refine_episodes)
    if p.tuner == LINES:
        search: Method = Lines(subject, p.seed, episodes=p.refine_episodes, coarse=COARSE, rounds=ROUNDS)
        climb(search, played, Journal(subject.names))
        return subject.at(search.theta), played.steps
    search = Autodiff(subject, p.seed, episodes=p.refine_episodes, **SHORT)
    climb(search, played, Journal(subject.names))
    ends = np.stack([subject.start, search.theta])
    means = played(Ask(ends, np.zeros(2, dtype=np.int64), p.refine_episodes)).mean(axis=1)
    return subject.at(ends[int(means.argmax())]), played.steps


@dataclass
class Refiner:
    """What the best individuals learn in a generation; handed to :func:`harness.ge.loop.evolve`."""

    grammar: Grammar
    fitness: ProgramFitness
    speller: Speller = field(init=False)

    def __post_init__(self) -> None:
        """Remembers how the grammar spells numbers, nothing else."""
        self.speller = Speller(self.grammar, self.fitness.parameters.codon_size)

    def __call__(self, individuals: Sequence[Parent], generation: int) -> tuple[list[Learnt], int]:
        """What each of the individuals has learnt, and the environment steps that it took.

        Those of one phenotype learn the same, at the cost of one.
        """
        known: dict[str, Program] = {}
        learnt, steps = [], 0
        for individual in individuals:
            text = individual.derivation.phenotype
            assert text is not None
            program = self.fitness.compile(text)
            places = self._places(individual, program)
            if places is None:
                learnt.append(Learnt(individual.codons, text))
                continue
            if text not in known:
                subject = _Spelled(program, places) if places else Constants(program)
                known[text], cost = tuned(self.fitness, subject, generation)
                steps += cost
            changed = known[text].text != program.text
            learnt.append(
                self._passed_on(individual, places, known[text]) if changed else Learnt(individual.codons, text)
            )
        return learnt, steps

    def _places(self, individual: Parent, program: Program) -> list[Place | None] | None:
        """Where the codons spell the constants, empty where that does not matter; None: there is nothing to tune."""
        if not len(program.constants):
            return None
        if self.fitness.parameters.inheritance != LAMARCKIAN:
            return []
        text = individual.derivation.phenotype
        if text is None or not individual.has_tree:
            return None
        places = self.speller.places(individual.codons, constant_spans(text, program.words))
        return places if any(places) else None

    def _passed_on(self, individual: Parent, places: list[Place | None], program: Program) -> Learnt:
        if not places:
            return Learnt(individual.codons, program.text)
        codons = self.speller.write(individual.codons, places, program.constants.tolist())
        text = derive(self.grammar, codons).phenotype
        assert text is not None
        return Learnt(codons, text)


def rivals(fitness: ProgramFitness, texts: Sequence[str], generation: int) -> tuple[list[str], int]:
    """The programs with tuned constants, where that changes them, and the environment steps that it took."""
    programs, made, steps = [fitness.compile(text) for text in texts], [], 0
    for program in programs:
        if len(program.constants):
            better, cost = tuned(fitness, Constants(program), generation)
            steps += cost
            made.append(better.text)
    known = {program.text for program in programs}
    return [text for text in dict.fromkeys(made) if text not in known], steps


def check_constants(grammar: Grammar, words: Words, written_back: bool) -> None:
    """Make sure that a grammar derives programs whose constants can be tuned, and written back where that is asked for.

    Raises:
        GrammarError: it does not, in any of some hundred sentences.
    """
    generator = np.random.default_rng(0)
    speller = Speller(grammar, 2**31 - 1)
    for i in range(_SAMPLES):
        codons = tree(grammar, 0, 6 + i % 20, GROW, 1000, generator)
        text = derive(grammar, codons).phenotype or ""
        if len(parse(text, words).constants) and (
            not written_back or any(speller.places(codons, constant_spans(text, words)))
        ):
            return
    how = "spells no number that a belief is compared with by rules of its own (such as 0.<digit><digit>)"
    without = "compares no belief with a number"
    raise GrammarError(
        f"{grammar.source} {how if written_back else without}, so --refine has nothing to "
        f"{'write back; take --inheritance baldwinian, or another grammar' if written_back else 'tune'}"
    )
