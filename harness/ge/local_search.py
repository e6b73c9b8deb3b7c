"""A memetic algorithm (Moscato 1989): the best individuals climb by edits of single statements, and pass on what they
found, for the edits are made in the codons."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from harness.engine import rng
from harness.ge.edits import Editor, Rng
from harness.ge.loop import Fitness, Learnt
from harness.ge.mapping import derive
from harness.ge.operators import Parent
from harness.ge.parameters import Parameters

_BATCH = 25
"""Neighbours evaluated together; the best of them is taken, if it is better."""
_ONE_MORE = 0.3
"""Probability that a neighbour is an edit further away: one edit alone seldom leaves a good program for a better."""


@dataclass(frozen=True)
class LocalSearch:
    """What the best individuals learn in a generation; handed to :func:`harness.ge.loop.evolve`."""

    editor: Editor
    fitness: Fitness
    parameters: Parameters

    def __call__(self, individuals: Sequence[Parent], generation: int) -> tuple[list[Learnt], int]:
        """What each of the individuals has become, and what the evaluations cost.

        Those of one phenotype become the same, at the cost of one.
        """
        generator = rng.generator(rng.TRAINING + self.parameters.seed, rng.LOCAL_SEARCH, generation)
        known: dict[str | None, Learnt] = {}
        cost = 0
        for individual in individuals:
            text = individual.derivation.phenotype
            if text not in known:
                known[text], spent = self._climb(individual, generation, generator)
                cost += spent
        return [known[individual.derivation.phenotype] for individual in individuals], cost

    def _climb(self, best: Parent, generation: int, generator: Rng) -> tuple[Learnt, int]:
        text = best.derivation.phenotype
        assert text is not None
        if not best.has_tree:  # it wraps: its nodes share codons
            return Learnt(best.codons, text), 0
        evaluated = self.fitness([text], generation)
        height, cost, seen = float(evaluated.fitness[0]), evaluated.cost, {text}
        for _ in range(0, self.parameters.local_search_evaluations, _BATCH):
            near = {name: a for name, a in self._near(best, generator).items() if name not in seen}
            seen |= near.keys()
            evaluated = self.fitness(list(near), generation)
            cost += evaluated.cost
            if near and evaluated.fitness.max() > height:
                text, best = list(near.items())[int(evaluated.fitness.argmax())]
                height = float(evaluated.fitness.max())
        return Learnt(best.codons, text), cost

    def _near(self, a: Parent, generator: Rng) -> dict[str, Parent]:
        """Some neighbours by their phenotypes."""
        found = {}
        for _ in range(_BATCH):
            codons = self.editor.edited(a, generator)
            codons = self.editor.mutated(Parent(codons, derive(self.editor.grammar, codons)), _ONE_MORE, generator)
            if len(codons) <= self.parameters.max_codons:
                near = Parent(codons, derive(self.editor.grammar, codons))
                if near.derivation.phenotype is not None:
                    found[near.derivation.phenotype] = near
        return found
