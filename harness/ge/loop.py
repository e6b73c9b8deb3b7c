"""The evolutionary loop: a population in, a population out, generation by generation.

It knows grammars and codons and nothing of POMDPs: a fitness is any function of phenotypes. Everything random in a
generation depends on (seed, generation) alone, so that a run can go on from any population as if never stopped.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

from harness.engine import rng as streams
from harness.ge import selection, structure
from harness.ge.grammar import Grammar
from harness.ge.initialisation import METHODS
from harness.ge.mapping import Codons, derive
from harness.ge.operators import CROSSOVERS, MUTATIONS, Parent, tournament
from harness.ge.parameters import NOVELTY, Parameters


class Evaluated(NamedTuple):
    """Fitness of phenotypes."""

    fitness: NDArray[np.float64]
    """One number a phenotype, higher is better."""
    behaviours: int
    """How many of them behave differently."""
    cost: int
    """What the evaluation cost, such as environment steps."""
    cases: NDArray[np.float64] | None = None
    """(phenotypes, E) fitness in each of E cases, of which the fitness is the mean, or what is expected of it; needed
    where breeding goes by cases."""
    descriptors: NDArray[np.float64] | None = None
    """(phenotypes, D) behaviour, every number from 0 to 1; needed where breeding goes by behaviour."""


Fitness = Callable[[Sequence[str], int], Evaluated]
"""(different phenotypes, generation) -> their fitness. The same arguments must give the same numbers."""


class Learnt(NamedTuple):
    """What became of an individual in its life."""

    codons: Codons
    """What it passes on: its own codons (Baldwin), or others that derive what it has learnt (Lamarck)."""
    phenotype: str
    """What it is judged by."""


Refine = Callable[[Sequence[Parent], int], tuple[list[Learnt], int]]
"""(valid individuals, generation) -> what each has learnt, and what that cost. A function of its arguments."""


class Lesson(NamedTuple):
    """That the best individuals learn from time to time."""

    learn: Refine
    best: int
    """How many phenotypes learn."""
    every: int
    """Generations from one time to the next."""


Mutate = Callable[[Grammar, Parent, float, int, np.random.Generator], Codons]
"""(grammar, parent, probability, codon size, generator) -> the codons of a child."""


class Past(NamedTuple):
    """What a generation hands on beside its population: with that and the seed, all that the next ones depend on."""

    born: NDArray[np.int32]
    """(individuals,) generation of the oldest ancestor of each."""
    seen: NDArray[np.float64]
    """(kept, D) behaviours in the archive of novelty search."""


def no_past(individuals: int) -> Past:
    """That of a first population."""
    return Past(np.zeros(individuals, dtype=np.int32), np.zeros((0, selection.DESCRIPTORS)))


class Generation(NamedTuple):
    """A population after its evaluation."""

    number: int
    population: Sequence[Codons]
    """As it was bred: evaluating it again gives this generation again."""
    individuals: list[Parent]
    phenotypes: list[str | None]
    """What each is judged by: its derivation's phenotype, or what it has learnt; None for invalid individuals."""
    fitness: NDArray[np.float64]
    """−inf for invalid individuals: no phenotype, or one that the fitness could make nothing of."""
    behaviours: int
    cost: int
    """Of all evaluations since the generation before, and of learning."""
    past: Past
    """As it was handed to the generation."""
    cases: NDArray[np.float64] | None = None
    """(individuals, E) as :attr:`Evaluated.cases`, −inf for invalid ones."""
    descriptors: NDArray[np.float64] | None = None
    """(individuals, D) as :attr:`Evaluated.descriptors`, −inf for invalid ones."""

    def best(self) -> str | None:
        """Phenotype of the fittest individual; None when all are invalid."""
        fittest = int(self.fitness.argmax())
        return self.phenotypes[fittest] if np.isfinite(self.fitness[fittest]) else None

    def ranking(self) -> dict[str, float]:
        """The different phenotypes and their fitness, best first."""
        order = np.argsort(-self.fitness, kind="stable")
        ranked: dict[str, float] = {}
        for i in order:
            text = self.phenotypes[i]
            if text is not None and np.isfinite(self.fitness[i]):
                ranked.setdefault(text, float(self.fitness[i]))
        return ranked


def first_population(grammar: Grammar, p: Parameters) -> list[Codons]:
    """The population of generation 0."""
    rng = _generator(p, 0)
    return METHODS[p.initialisation](grammar, p.population, p.max_init_depth, p.codon_size, p.tail, rng)


def evolve(
    grammar: Grammar,
    p: Parameters,
    fitness: Fitness,
    population: Sequence[Codons],
    start: int = 0,
    past: Past | None = None,
    lessons: Sequence[Lesson] = (),
    mutate: Mutate | None = None,
) -> Iterator[Generation]:
    """Yield every evaluated generation from ``start``, whose population and past are given, to ``p.generations``.

    In the generational scheme the elites and the children of selected parents replace everybody; elites are
    evaluated anew like the others, so that a lucky fitness does not last. In the steady-state scheme two children at
    a time replace the two worst, if they are better. With ``lessons`` the best phenotypes learn before they breed, in
    this order. ``mutate`` stands in for the mutation that ``p`` names.
    """
    mutate = mutate or MUTATIONS[p.mutation]
    individuals = [_mapped(grammar, p, codons) for codons in population]
    generation = _evaluate(p, fitness, individuals, start, past or no_past(len(population)))
    while True:
        for lesson in lessons:
            if generation.number and generation.number % lesson.every == 0:
                generation = _taught(grammar, p, fitness, lesson, generation)
        yield generation
        if generation.number >= p.generations:
            return
        cost, past = 0, generation.past
        if p.replacement == "steady-state":
            individuals, cost = _steady_state(grammar, p, fitness, generation, mutate)
        else:
            individuals, past = next_population(grammar, p, generation, mutate)
        generation = _evaluate(p, fitness, individuals, generation.number + 1, past)
        generation = generation._replace(cost=generation.cost + cost)


def _taught(grammar: Grammar, p: Parameters, fitness: Fitness, lesson: Lesson, generation: Generation) -> Generation:
    """Let the best learn; they are judged anew by the generation's own episodes, like everybody."""
    known = generation.ranking()
    best = list(known)[: lesson.best]
    chosen = [i for i, text in enumerate(generation.phenotypes) if text in best]
    learnt, cost = lesson.learn([generation.individuals[i] for i in chosen], generation.number)
    different = [text for text in dict.fromkeys(new.phenotype for new in learnt) if text not in known]
    evaluated = fitness(different, generation.number)
    individuals, phenotypes = list(generation.individuals), list(generation.phenotypes)
    row_of = {text: i for i, text in reversed(list(enumerate(phenotypes)))}
    row_of |= {text: len(phenotypes) + k for k, text in enumerate(different)}
    rows = np.arange(len(phenotypes))
    for i, new in zip(chosen, learnt, strict=True):
        individuals[i] = _mapped(grammar, p, new.codons)
        phenotypes[i], rows[i] = new.phenotype, row_of[new.phenotype]
    return generation._replace(
        individuals=individuals,
        phenotypes=phenotypes,
        fitness=np.concatenate([generation.fitness, evaluated.fitness])[rows],
        cases=_of_both(generation.cases, evaluated.cases, rows),
        descriptors=_of_both(generation.descriptors, evaluated.descriptors, rows),
        cost=generation.cost + cost + evaluated.cost,
    )


def _of_both(
    before: NDArray[np.float64] | None, new: NDArray[np.float64] | None, rows: NDArray[np.intp]
) -> NDArray[np.float64] | None:
    return None if before is None or new is None else np.concatenate([before, new])[rows]


def next_population(
    grammar: Grammar, p: Parameters, generation: Generation, mutate: Mutate
) -> tuple[list[Parent], Past]:
    """Survivors and children of selected parents, group by group; and what they hand on."""
    rng, number = _generator(p, generation.number + 1), generation.number + 1
    pools = structure.pools(p, generation.fitness, generation.past.born, number)
    population: list[Parent] = []
    born: list[int] = []
    for places, members in zip(structure.groups(p), pools, strict=True):
        if len(members):
            bred = _bred(grammar, p, generation, members, len(places), mutate, rng)
        else:
            new = METHODS[p.initialisation](grammar, len(places), p.max_init_depth, p.codon_size, p.tail, rng)
            bred = [(_mapped(grammar, p, codons), number) for codons in new]
        population += [individual for individual, _ in bred]
        born += [birth for _, birth in bred]
    seen = generation.past.seen
    if p.selection == NOVELTY:
        seen = selection.remembered(_pool(generation), rng)
    return population, Past(np.array(born, dtype=np.int32), seen)


def _pool(generation: Generation) -> selection.Pool:
    return selection.Pool(generation.fitness, generation.cases, generation.descriptors, generation.past.seen)


def _bred(
    grammar: Grammar,
    p: Parameters,
    generation: Generation,
    members: NDArray[np.intp],
    room: int,
    mutate: Mutate,
    rng: np.random.Generator,
) -> list[tuple[Parent, int]]:
    """As many individuals as there is ``room`` for, survivors and children of ``members``; and when the oldest ancestor
    of each was born."""
    pool = _pool(generation).only(members)
    if p.distinct:
        different = selection.distinct(pool)
        members, pool = members[different], pool.only(different)
    kept = selection.survivors(pool, p, room)
    individuals = [generation.individuals[i] for i in members]
    born = generation.past.born[members].tolist()
    bred = [(individuals[i], born[i]) for i in kept]
    pairs = selection.parents(pool, kept, p, room + room % 2, rng).reshape(-1, 2)
    for i, j in pairs[: (room - len(kept) + 1) // 2]:
        children = _children(grammar, p, individuals[i], individuals[j], mutate, rng)
        bred += [(child, min(born[i], born[j])) for child in children]
    return bred[:room]


def _steady_state(
    grammar: Grammar, p: Parameters, fitness: Fitness, generation: Generation, mutate: Mutate
) -> tuple[list[Parent], int]:
    """As many children as there are individuals, two at a time, all judged by the generation's episodes; and the cost
    of judging them."""
    rng = _generator(p, generation.number + 1)
    individuals, scores = list(generation.individuals), generation.fitness.copy()
    cost = 0
    for _ in range(p.population // 2):
        i, j = tournament(scores, p.tournament, 2, rng)
        children = _children(grammar, p, individuals[i], individuals[j], mutate, rng)
        born = _evaluate(p, fitness, children, generation.number, no_past(2))
        cost += born.cost
        worst = np.argsort(scores, kind="stable")[:2]
        for k, child in zip(worst, np.argsort(-born.fitness, kind="stable"), strict=True):
            if born.fitness[child] > scores[k]:
                individuals[k], scores[k] = born.individuals[child], born.fitness[child]
    return individuals, cost


def _children(
    grammar: Grammar, p: Parameters, a: Parent, b: Parent, mutate: Mutate, rng: np.random.Generator
) -> list[Parent]:
    pair = a.codons, b.codons
    if rng.random() < p.crossover_probability:
        pair = CROSSOVERS[p.crossover](a, b, rng)
    children = []
    for codons, parent in zip(pair, (a, b), strict=True):
        child = _with(grammar, p, parent, codons[: p.max_codons] if len(codons) > p.max_codons else codons)
        changed = mutate(grammar, child, p.mutation_probability, p.codon_size, rng)
        children.append(_with(grammar, p, child, changed))
    return children


def _with(grammar: Grammar, p: Parameters, known: Parent, codons: Codons) -> Parent:
    """An individual with these codons: operators that change nothing give back the very array, which is mapped
    already."""
    return known if codons is known.codons else _mapped(grammar, p, codons)


def _mapped(grammar: Grammar, p: Parameters, codons: Codons) -> Parent:
    return Parent(codons, derive(grammar, codons, p.max_wraps))


def _evaluate(p: Parameters, fitness: Fitness, individuals: list[Parent], number: int, past: Past) -> Generation:
    """Evaluate each different phenotype once."""
    phenotypes = [individual.derivation.phenotype for individual in individuals]
    different = list(dict.fromkeys(text for text in phenotypes if text is not None))
    evaluated = fitness(different, number)
    row_of: dict[str | None, int] = {None: -1} | {text: k for k, text in enumerate(different)}
    at = np.array([row_of[text] for text in phenotypes])
    return Generation(
        number,
        [individual.codons for individual in individuals],
        individuals,
        phenotypes,
        rows_of(evaluated.fitness, at),
        evaluated.behaviours,
        evaluated.cost,
        past,
        rows_of(evaluated.cases, at),
        rows_of(evaluated.descriptors, at),
    )


@overload
def rows_of(values: NDArray[np.float64], at: NDArray[np.intp]) -> NDArray[np.float64]: ...
@overload
def rows_of(values: NDArray[np.float64] | None, at: NDArray[np.intp]) -> NDArray[np.float64] | None: ...
def rows_of(values: NDArray[np.float64] | None, at: NDArray[np.intp]) -> NDArray[np.float64] | None:
    """Rows of ``values``, −inf where the number of the row is −1; None where there are no values."""
    if values is None:
        return None
    return np.concatenate([values, np.full((1, *values.shape[1:]), -np.inf)])[at]


def _generator(p: Parameters, generation: int) -> np.random.Generator:
    return streams.generator(streams.TRAINING + p.seed, streams.VARIATION, generation)
