"""Fitness for anybody's optimiser: from candidates to arrays of returns, batched and compiled."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from harness import cards, host, registry
from harness.engine import rng
from harness.errors import HarnessError, check_whole, quoted
from harness.ge.defaults import grammar_for
from harness.ge.fitness import check_language
from harness.ge.mapping import derive
from harness.ge.parameters import Parameters
from harness.model.domain import Domain
from harness.play import population
from harness.play.evaluation import HORIZON, check_played, evaluate
from harness.policy import Policy, named
from harness.program import Program, ProgramError, parse, words_of
from harness.tuning.method import Ask
from harness.tuning.objective import SEEDS, Episodes
from harness.tuning.tunable import Tunable, tunable

Candidate: TypeAlias = "str | Policy | ArrayLike"
_WRAPS = Parameters().max_wraps
_LARGEST_CODON = 2**31 - 1


class Evaluator:
    """A function from candidates to their fitness, the mean undiscounted return: more is better.

    A candidate is a program's text, or a policy object, such as a finite-state :class:`harness.Controller`; or with
    ``grammar`` a sequence of codons (whole numbers from 0), mapped as :func:`harness.evolve` maps them; or with
    ``policy`` a vector of the numbers of a tunable policy, such as ``thresholds`` or a :class:`harness.Tunable`. All
    candidates meet the same episodes: those of the range of seeds that is kept for searches, which no evaluation
    plays. So score what was found by :func:`harness.evaluate`, on episodes that it was not chosen by.

    What is no program (a text that does not parse, codons whose derivation does not end) has the fitness −inf, and
    :meth:`fault` says why. An evaluator can be pickled and sent to other processes; the numbers do not depend on where
    and in what company a candidate is evaluated.
    """

    def __init__(
        self,
        domain: Domain | str,
        grammar: str | Path | None = None,
        *,
        policy: str | Tunable | None = None,
        episodes: int = 1_000,
        seed: int = 0,
        horizon: int = HORIZON,
        max_wraps: int = _WRAPS,
        workers: int | None = None,
    ) -> None:
        """An evaluator.

        Args:
            domain: a domain or its name; its shaping is what is paid.
            grammar: name or BNF file of the grammar that codons are mapped by.
            policy: a policy string with numbers to tune, or a Tunable.
            episodes: number M of episodes a candidate.
            seed: of the episodes, below 2⁶¹.
            horizon: steps after which an episode is truncated.
            max_wraps: how often codons are read again from the first.
            workers: threads (default: one a core); take 1 where the optimiser has processes of its own.

        Raises:
            HarnessError: an argument is wrong, or both a grammar and a policy are given.
        """
        if grammar is not None and policy is not None:
            raise HarnessError("an evaluator takes a grammar (for codons) or a policy (for vectors), not both")
        check_played(seed=0, horizon=horizon, episodes=episodes)
        check_whole("seed", seed, 0, SEEDS - 1)
        check_whole("max_wraps", max_wraps, 0, 1_000)
        self.domain = registry.load(domain) if isinstance(domain, str) else domain
        self.grammar = None if grammar is None else grammar_for(self.domain, grammar)
        self.subject = None if policy is None else tunable(policy, self.domain)
        self.episodes, self.seed, self.horizon, self.max_wraps = episodes, seed, horizon, max_wraps
        self.workers = host.workers(workers)
        if self.grammar is not None:
            check_language(self.grammar, words_of(self.domain))

    def __call__(self, candidates: Sequence[Candidate] | NDArray[Any], *, first: int = 0) -> NDArray[np.float64]:
        """(n,) mean undiscounted return of each of n candidates, −inf for what is no program.

        ``first``: number of the first episode; ``generation * episodes`` gives every generation episodes of its own.

        Raises:
            HarnessError: a candidate is of no kind that this evaluator takes, or a vector is out of bounds.
        """
        return self.returns(candidates, first=first).mean(axis=1)

    def returns(self, candidates: Sequence[Candidate] | NDArray[Any], *, first: int = 0) -> NDArray[np.float64]:
        """(n, M) undiscounted return of each of n candidates in each episode; else as a call.

        Raises:
            HarnessError: as a call.
        """
        check_played(seed=0, horizon=1, first=first)
        if isinstance(candidates, str):
            raise HarnessError("candidates are a list: for one program give [text]")
        if self.subject is not None:
            return self._of_vectors(self.subject, candidates, first)
        found = [self._playable(candidate) for candidate in candidates]
        returns = np.full((len(found), self.episodes), -np.inf)
        programs = [i for i, each in enumerate(found) if isinstance(each, Program)]
        if programs:
            returns[programs] = self._of_programs([found[i] for i in programs], first)
        for i, each in enumerate(found):
            if isinstance(each, Policy):
                returns[i] = self._of_policy(each, first)
        return returns

    def text(self, candidate: Candidate) -> str | None:
        """What a candidate stands for: a program's text, a policy string, or the name of a policy object.

        None for codons without a program.

        Raises:
            HarnessError: it is of no kind that this evaluator takes.
        """
        if self.subject is not None:
            return self.subject.text(self._points(self.subject, [candidate])[0])
        if isinstance(candidate, str):
            return candidate
        if isinstance(candidate, Policy):
            return named(candidate, self.domain)[0]
        if self.grammar is None:
            raise HarnessError(f"{quoted(candidate)} is no program's text, and without a grammar codons mean nothing")
        return derive(self.grammar, _codons(candidate), self.max_wraps).phenotype

    def fault(self, candidate: Candidate) -> str | None:
        """Why a candidate is no program, in a sentence; None if it is one, and for vectors and policies."""
        if self.subject is not None:
            return None
        found = self._playable(candidate)
        if found is None:
            return f"the derivation does not end within {self.max_wraps} wraps of the codons"
        return str(found) if isinstance(found, ProgramError) else None

    def _playable(self, candidate: Candidate) -> Program | Policy | ProgramError | None:
        if isinstance(candidate, Policy):
            return candidate
        text = self.text(candidate)
        try:
            return None if text is None else parse(text, words_of(self.domain))
        except ProgramError as error:
            return error

    def _of_programs(self, programs: Sequence[Any], first: int) -> NDArray[np.float64]:
        episodes = population.Episodes(rng.TRAINING + self.seed, first, self.episodes, self.horizon)
        return population.play(self.domain, programs, episodes, workers=self.workers).returns

    def _of_policy(self, policy: Policy, first: int) -> NDArray[np.float64]:
        return evaluate(
            self.domain,
            policy,
            episodes=self.episodes,
            seed=rng.TRAINING + self.seed,
            first=first,
            horizon=self.horizon,
            engine="tables",
            workers=self.workers,
        ).returns

    def _of_vectors(self, subject: Tunable, candidates: Any, first: int) -> NDArray[np.float64]:
        points = self._points(subject, candidates)
        if not len(points):
            return np.empty((0, self.episodes))
        play = Episodes(self.domain, subject, self.seed, self.horizon, "return", "tables", self.workers)
        return play(Ask(points, np.full(len(points), first), self.episodes))

    def _points(self, subject: Tunable, candidates: Any) -> NDArray[np.float64]:
        wanted = f"vectors of {len(subject.names)} numbers ({', '.join(subject.names)})"
        try:
            points = np.array(candidates, dtype=np.float64).reshape(len(candidates), len(subject.names))
        except (TypeError, ValueError):
            raise HarnessError(f"candidates must be {wanted}, not {quoted(candidates)}") from None
        outside = ~((points >= subject.lower) & (points <= subject.upper)).all(axis=1)
        if outside.any():
            raise HarnessError(f"{quoted(points[outside][0].tolist())} is out of the bounds of {wanted}")
        return points

    def __repr__(self) -> str:
        """What is evaluated, on one line."""
        facts: dict[str, object] = {"episodes": self.episodes, "seed": self.seed, "horizon": self.horizon}
        if self.grammar is not None:
            facts["grammar"] = self.grammar.source
        if self.subject is not None:
            facts["numbers"] = ", ".join(self.subject.names)
        return cards.line("Evaluator", self.domain.name, facts)


def _codons(candidate: Any) -> NDArray[np.int32]:
    """The codons of a candidate; whole numbers given as floats, as some optimisers do, will do."""
    try:
        array = np.asarray(candidate, dtype=np.float64)
    except (TypeError, ValueError):
        array = np.empty((0, 0))
    if array.ndim != 1 or not ((array >= 0) & (array <= _LARGEST_CODON) & (array == np.floor(array))).all():
        raise HarnessError(f"codons must be whole numbers from 0 to {_LARGEST_CODON}, not {quoted(candidate)}")
    return array.astype(np.int32)
