"""What an evolutionary run can be told. The command line, the run folder and the checks are made from this one list."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

from harness.errors import HarnessError, nearest, quoted

# The words alone: the command line's parser needs them, and not the compiled code that they stand for.
INITIALISATIONS = ("ramped", "pi-grow", "uniform")
CROSSOVERS = ("one-point", "fixed-one-point", "subtree")
MUTATIONS = ("per-codon", "per-genome", "subtree", "structural", "edits")
EDITS = "edits"
TOURNAMENT, LEXICASE, NOVELTY, MAP_ELITES = SELECTIONS = ("tournament", "lexicase", "novelty", "map-elites")
GENERATIONAL, _ = REPLACEMENTS = ("generational", "steady-state")
SAMPLED, EXACT, AUTO = FITNESSES = ("sampled", "exact", "auto")
RETURN, DISCOUNTED = OBJECTIVES = ("return", "discounted")
NOWHERE, ANYWHERE, PAYING = WALKS = ("nowhere", "anywhere", "paying")
LINES, AUTODIFF = TUNERS = ("lines", "autodiff")
LAMARCKIAN, BALDWINIAN = INHERITANCES = ("lamarckian", "baldwinian")

_MOST = 1_000_000  # of every number that names no other limit
_MOST_TOGETHER = 100_000_000
"""Numbers that a generation holds at once, such as returns of all programs in all episodes: 0.8 GB."""


def _parameter(
    default: Any, text: str, choices: Any = (), least: float | None = None, most: float | None = None
) -> Any:
    if most is None and not isinstance(default, (str, bool)):
        most = _MOST
    return field(default=default, metadata={"help": text, "choices": tuple(choices), "least": least, "most": most})


@dataclass(frozen=True)
class Parameters:
    """Parameters of a run; the defaults are those of the paper's Table 2, and SPEC section 4 where it is silent."""

    population: int = _parameter(250, "individuals", least=2)
    generations: int = _parameter(500, "generations after the first population", least=0)
    episodes: int = _parameter(100, "episodes whose mean is the fitness, new ones in every generation", least=1)
    horizon: int = _parameter(50, "steps an episode lasts", least=1)
    fitness: str = _parameter(
        SAMPLED, "return that selects: mean of the episodes, expected, or expected where that is quick", FITNESSES
    )
    objective: str = _parameter(RETURN, "what is to be high: the return, or that at the domain's discount", OBJECTIVES)
    seed: int = _parameter(0, "of everything random in the run", least=0, most=2**31 - 1)
    shaping: str = _parameter("none", "reward shaping during the search: none, or of BorderCross paper, potential")
    loop: bool = _parameter(False, "programs start again at the top until the episode ends")
    penalty: float = _parameter(0.1, "fitness lost for every statement beyond --free-length", least=0)
    free_length: int = _parameter(50, "statements that cost nothing", least=0)
    initialisation: str = _parameter("ramped", "of the first population", INITIALISATIONS)
    max_init_depth: int = _parameter(50, "levels of the first population's derivation trees", least=1, most=1000)
    codon_size: int = _parameter(1000, "codons are whole numbers below this", least=2, most=2**31 - 1)
    tail: float = _parameter(0.5, "unused codons appended at first, as a share of the used ones", least=0, most=10)
    max_wraps: int = _parameter(
        0, "times that the codons are read again before an individual is invalid", least=0, most=1000
    )
    max_codons: int = _parameter(2000, "longer genotypes are cut", least=1)
    tournament: int = _parameter(2, "individuals in a selection tournament", least=1)
    selection: str = _parameter(TOURNAMENT, "of parents", SELECTIONS)
    cases: float = _parameter(
        1.0, "share of a generation's episodes that lexicase selection goes by, drawn anew each time", least=0, most=1
    )
    distinct: bool = _parameter(False, "of individuals that earn the same in every episode, only one breeds")
    islands: int = _parameter(1, "groups that breed apart; their best migrate to the next", least=1)
    layers: int = _parameter(1, "groups by age, the youngest of which begins anew (ALPS)", least=1)
    epoch: int = _parameter(10, "generations from one migration, or one new youngest layer, to the next", least=1)
    elites: int = _parameter(1, "best individuals that pass on unchanged", least=0)
    crossover: str = _parameter("one-point", "of two parents", CROSSOVERS)
    crossover_probability: float = _parameter(0.75, "that two parents are crossed", least=0, most=1)
    mutation: str = _parameter("per-codon", "of a child", MUTATIONS)
    mutation_probability: float = _parameter(0.01, "of each codon, or of a child", least=0, most=1)
    walks: str = _parameter(
        NOWHERE, "where edits put in a stop, with ways to it and on from it: where actions pay, or anywhere", WALKS
    )
    replacement: str = _parameter("generational", "how children enter the population", REPLACEMENTS)
    local_search: int = _parameter(0, "best programs that climb by edits of statements (0: none)", least=0)
    local_search_every: int = _parameter(5, "generations from one climb to the next", least=1)
    local_search_evaluations: int = _parameter(250, "programs tried in a climb", least=1)
    refine: int = _parameter(0, "best programs whose constants are tuned at the end (0: none)", least=0)
    refine_every: int = _parameter(0, "generations from one tuning of the best ones' constants to the next", least=0)
    inheritance: str = _parameter(
        LAMARCKIAN, "of constants tuned on the way: written into the codons, or only credited", INHERITANCES
    )
    tuner: str = _parameter(LINES, "search that tunes constants", TUNERS)
    refine_episodes: int = _parameter(100, "episodes on which constants are tuned", least=2)
    test_episodes: int = _parameter(1000, "fresh episodes that score each generation's best in the history", least=2)
    finalists: int = _parameter(20, "programs of the last generation that are compared once more", least=1)
    validation_episodes: int = _parameter(2000, "episodes of that comparison, which no generation has seen", least=2)
    score_episodes: int = _parameter(10_000, "fresh episodes that score the winner", least=2)

    def __post_init__(self) -> None:
        """Check every value.

        Raises:
            HarnessError: a value is out of its range or of the wrong type.
        """
        for f in fields(self):
            _check(f.name, getattr(self, f.name), f.default, f.metadata)
        if self.elites >= self.population:
            raise HarnessError(f"elites must be fewer than the population of {self.population}, not {self.elites}")
        self._check_structure()
        if self.refine_every and not self.refine:
            raise HarnessError("refine_every needs refine, the number of programs whose constants are tuned")
        if self.walks != NOWHERE and self.mutation != EDITS and not self.local_search:
            raise HarnessError("walks are taken by edits: they need mutation edits, or local_search")
        for name in ("episodes", "max_codons", "tournament"):
            _check_together(self.population, name, getattr(self, name))

    @property
    def uses_cases(self) -> bool:
        """Whether breeding needs the fitness in each episode."""
        return self.selection == LEXICASE or (self.distinct and self.fitness == SAMPLED)

    @property
    def breeds_by_play(self) -> bool:
        """Whether breeding needs more of what became of a generation's episodes than the fitness does."""
        return self.selection != TOURNAMENT and self.fitness != SAMPLED

    def _check_structure(self) -> None:
        groups = max(self.islands, self.layers)
        if self.replacement != GENERATIONAL and (self.selection != TOURNAMENT or self.distinct or groups > 1):
            raise HarnessError(
                f"replacement {self.replacement} knows {TOURNAMENT} selection in one population only; "
                f"take replacement {GENERATIONAL}"
            )
        if min(self.islands, self.layers) > 1:
            raise HarnessError("a population has islands or layers, not both")
        if groups > 1 and self.population // groups <= max(self.elites, 1):
            raise HarnessError(
                f"{groups} groups of a population of {self.population} are too small for {self.elites} elites each; "
                "take fewer islands or layers, or a larger population"
            )


def from_record(record: dict[str, Any]) -> Parameters:
    """Parameters from names and values.

    Raises:
        HarnessError: a name is unknown, or a value out of range.
    """
    known = [f.name for f in fields(Parameters)]
    for name in record:
        if name not in known:
            raise HarnessError(f"no parameter {quoted(name)}{nearest(name, known)} (known: {', '.join(known)})")
    return Parameters(**record)


def check_value(name: str, value: Any) -> None:
    """Check one parameter by itself.

    Raises:
        HarnessError: the name is unknown, or the value out of its range or of the wrong type.
    """
    known = {f.name: f for f in fields(Parameters)}
    if name not in known:
        raise HarnessError(f"no parameter {quoted(name)}{nearest(name, known)} (see: harness evolve --help)")
    _check(name, value, known[name].default, known[name].metadata)


def _check_together(population: int, name: str, count: int) -> None:
    if population * count > _MOST_TOGETHER:
        raise HarnessError(
            f"population and {name} must be {_MOST_TOGETHER:,} or less when multiplied, not {population * count:,}"
        )


def _check(name: str, value: Any, default: Any, limits: Any) -> None:
    kind = type(default)
    right = isinstance(value, (int, float)) if kind is float else isinstance(value, kind)
    if not right or (isinstance(value, bool) and kind is not bool):
        words = {int: "a whole number", float: "a number", str: "a word", bool: "true or false"}
        raise HarnessError(f"{name} must be {words[kind]}, not {quoted(value)}")
    if limits["choices"] and value not in limits["choices"]:
        choices = limits["choices"]
        raise HarnessError(f"no {name} {quoted(value)}{nearest(value, choices)} (known: {', '.join(choices)})")
    if limits["least"] is not None and not value >= limits["least"]:
        raise HarnessError(f"{name} must be {limits['least']} or more, not {quoted(value)}")
    if limits["most"] is not None and not value <= limits["most"]:
        raise HarnessError(f"{name} must be {limits['most']} or less, not {quoted(value)}")
