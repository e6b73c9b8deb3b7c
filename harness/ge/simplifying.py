"""Programs that people can read: what changes nothing is taken out, and how often each line acts."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from harness import cards, host, registry
from harness import policy as policies
from harness.engine import rng
from harness.errors import HarnessError, check_whole, quoted
from harness.expectation.programs import expected
from harness.ge.fitness import ROOM
from harness.model.domain import Domain
from harness.model.tables import STOP
from harness.play import population
from harness.play.evaluation import HORIZON, check_played, simulate
from harness.play.population import Episodes
from harness.policy import Policy
from harness.policy.program import ProgramPolicy
from harness.policy.team import ProgramTeam, policy_of
from harness.program import Program, ProgramError, parse, shorter, words_of
from harness.progress import Bar, Progress

EPISODES = 20_000
"""On which a program is judged whose exact return takes too many situations."""
_ACTING = 1_000  # episodes that tell how often lines act
_ROUNDING = 1e-9
_TOGETHER = 16  # programs judged at once: shared out among the threads, and few beyond the first that will do


class Simplified(NamedTuple):
    """A program, what is left of it, and how that was judged."""

    original: Program
    program: Program
    before: float
    """Mean undiscounted return of the original."""
    after: float
    """Of what is left, never below by more than rounding."""
    episodes: int
    """On which both were judged; 0: exactly."""

    @property
    def how(self) -> str:
        """In words."""
        return f"on {self.episodes:,} episodes" if self.episodes else "exactly"

    def __repr__(self) -> str:
        """What has become of it, on one line."""
        facts: dict[str, object] = {
            "statements": f"{self.original.length} → {self.program.length}",
            "return": f"{self.before:.4f} → {self.after:.4f}",
            "judged": self.how,
        }
        return cards.line("Simplified", f"program of {self.program.words.domain.name}", facts)


def simplify(
    domain: Domain | str,
    program: Program | Policy | str,
    *,
    episodes: int | None = None,
    seed: int = 0,
    horizon: int = HORIZON,
    workers: int | None = None,
    progress: Progress = False,
) -> Simplified:
    """Take out of a program whatever it earns no less without: statements, ``else`` parts and conditions.

    One piece at a time, from the last line to the first, until none can go; then, where returns are exact, two
    statements at a time, as of moves one of which undoes the other. What is left is compared with the original, never
    with what it was a piece ago, so that small losses do not add up.

    Args:
        domain: a domain or its name; its shaping is what is paid.
        program: a program, its text (of several lines), or a policy string such as ``ge`` or ``program:FILE``.
        episodes: judge on so many episodes, the same throughout. By default the expected return is computed, or 20,000
            episodes are played where that takes more than 100,000 situations a step.
        seed: of the episodes, which are those kept for searches.
        horizon: steps after which an episode is truncated.
        workers: threads (default: one a core).
        progress: True for a bar on a terminal, or a function that is called with numbers of pieces tried.

    Raises:
        HarnessError: an argument is wrong, or the policy is no program.
    """
    domain = registry.load(domain) if isinstance(domain, str) else domain
    check_played(seed=0, horizon=horizon, episodes=EPISODES if episodes is None else episodes)
    check_whole("seed", seed, 0, 2**61 - 1)
    original = program_of(domain, program)
    judge = _Judge(domain, seed, horizon, host.workers(workers), episodes or 0)
    before = judge([original])[0]
    if np.isnan(before):
        judge = judge._replace(episodes=EPISODES)
        before = judge([original])[0]
    floor = before - _ROUNDING * max(1.0, abs(before))
    with Bar(progress, None, desc="simplifying", unit="piece") as bar:
        left = _least(original, _Search(judge, floor, bar), exact=not judge.episodes)
    return Simplified(original, left, float(before), float(judge([left])[0]), judge.episodes)


class _Judge(NamedTuple):
    """Mean returns of programs: exact, or on episodes; NaN where one takes too many situations."""

    domain: Domain
    seed: int
    horizon: int
    workers: int
    episodes: int

    def __call__(self, programs: Sequence[Program]) -> NDArray[np.float64]:
        if not self.episodes:
            return expected(self.domain, programs, self.horizon, ROOM, self.workers).returns
        played = Episodes(rng.REFINEMENT + self.seed, 0, self.episodes, self.horizon)
        return population.play(self.domain, programs, played, workers=self.workers).returns.mean(axis=1)


class _Search(NamedTuple):
    """Finds the first program that earns enough."""

    judge: _Judge
    floor: float
    bar: Bar

    def __call__(self, programs: Iterable[Program]) -> Program | None:
        waiting = iter(programs)
        while chunk := list(itertools.islice(waiting, _TOGETHER)):
            self.bar.update(len(chunk))
            enough = self.judge(chunk) >= self.floor
            if enough.any():
                return chunk[int(enough.argmax())]
        return None


def program_of(domain: Domain, given: Program | Policy | str) -> Program:
    """A program of a domain: itself, or by its text or a policy string.

    Raises:
        HarnessError: it is no program.
    """
    if isinstance(given, str) and "\n" in given:
        return parse(given, words_of(domain))
    made = policies.make(given, domain)[1] if isinstance(given, str) else given
    found = made.program if isinstance(made, (ProgramPolicy, ProgramTeam)) else made
    if not isinstance(found, Program):
        raise HarnessError(f"{quoted(given)} is no program; give program:FILE, or a program's text")
    return found


def _least(program: Program, first: _Search, exact: bool) -> Program:
    """The program without all that can go one after the other."""
    while True:
        found = _pass(program, first)
        if found is program and exact:
            found = first(_pairs(program)) or program
        if found is program:
            return program
        program = found


def _pass(program: Program, first: _Search) -> Program:
    """Without the pieces that can go, each tried once, from the last line to the first; itself where none can."""
    at = program.text.count("\n") - 1
    while at >= 0:
        program = first(_without(program, at)) or program
        at = min(at, program.text.count("\n")) - 1
    return program


def _without(program: Program, at: int) -> Iterator[Program]:
    """The program with a piece less of the statement on a line."""
    for lines in shorter.candidates(program.text.splitlines(), at):
        yield from _parsed(lines, program)


def _pairs(program: Program) -> Iterator[Program]:
    """The program without two of its statements."""
    lines = program.text.splitlines()
    for late in reversed(range(len(lines))):
        for rest in itertools.islice(shorter.candidates(lines, late), 1):
            for early in reversed(range(late)):
                for left in itertools.islice(shorter.candidates(rest, early), 1):
                    yield from _parsed(left, program)


def _parsed(lines: Sequence[str], program: Program) -> Iterator[Program]:
    """None where a block has lost its last statement: the block as a whole is another candidate."""
    with contextlib.suppress(ProgramError):
        yield parse("\n".join(lines), program.words, loop=program.loop)


def acting(domain: Domain, program: Program, *, seed: int = 0, horizon: int = HORIZON) -> NDArray[np.float64]:
    """(lines,) how often each line of a program's text acts in an episode, the mean of 1,000 episodes of a seed."""
    follow, counts = policy_of(program), np.zeros(program.text.count("\n"))
    for step in simulate(domain, policy_of(program), "tables", seed, 0, _ACTING, horizon):
        if step.actions is None:
            follow.reset(step.batch)
        if step.batch.step < horizon:  # what is done next, by the same program on what the played one sees
            acts = (follow.act(step.batch) != STOP) & ~step.batch.done
            np.add.at(counts, program.line_of[follow.at[acts]], 1)
    return counts / _ACTING


def acts(domain: Domain, programs: Mapping[str, Program], *, seed: int = 0, horizon: int = HORIZON) -> pd.DataFrame:
    """How often the lines of several programs act: one row a line, columns ``program``, ``line`` (text), ``acts``."""
    tables = []
    for name, program in programs.items():
        often = acting(domain, program, seed=seed, horizon=horizon)
        tables.append(pd.DataFrame({"program": name, "line": program.text.splitlines(), "acts": often}))
    return pd.concat(tables, ignore_index=True)
