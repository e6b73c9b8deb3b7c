"""Many programs on the same episodes: what evolution and the tuning of constants need.

The embedded engine plays every episode of a program from start to end in one compiled loop; the random numbers, the
starts and the first beliefs are made once for all programs. The returns are those that
:func:`harness.play.evaluation.evaluate` gives for the same episodes, bit for bit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness import host
from harness.engine import rng
from harness.engine.philox import uniform_table
from harness.engine.tables import TablesEngine
from harness.errors import PolicyError
from harness.model.domain import Domain
from harness.model.tables import Records
from harness.play import executor, teams
from harness.play.evaluation import simulate
from harness.play.executor import Workers
from harness.play.together import play_together
from harness.policy.team import policy_of
from harness.program import Program, Words
from harness.program.words import BELIEF, INSTRUCTION


class Episodes(NamedTuple):
    """Which episodes to play: numbers ``first … first + size − 1`` of a seed, cut at the horizon."""

    seed: int
    first: int
    size: int
    horizon: int


class Played(NamedTuple):
    """What became of P programs in E episodes."""

    returns: NDArray[np.float64]
    """(P, E) of the domain's shaping."""
    steps: NDArray[np.int64]
    """(P,) environment steps in all episodes together."""
    visited: NDArray[np.int64]
    """(P,) different visible values that an episode has seen, added up over the episodes."""
    readings: NDArray[np.int64]
    """(P,) steps in all episodes together whose observation was not the domain's "none"."""

    def part(self, chunk: slice) -> Played:
        """That of some programs, a view."""
        return Played(self.returns[chunk], self.steps[chunk], self.visited[chunk], self.readings[chunk])


def _nothing(programs: int, episodes: int) -> Played:
    """Of episodes that have not begun."""
    return Played(np.zeros((programs, episodes)), *(np.zeros(programs, dtype=np.int64) for _ in range(3)))


def play(
    domain: Domain,
    programs: Sequence[Program],
    episodes: Episodes,
    engine: str = "tables",
    workers: int = 1,
    discount: float = 1.0,
) -> Played:
    """Play every program in every episode.

    Args:
        domain: all programs must have been compiled for it.
        programs: the programs.
        episodes: which episodes; all programs meet the same random numbers.
        engine: ``tables`` or ``julia``.
        workers: threads of the tables engine; the numbers do not depend on it.
        discount: what a reward loses with every step.
    """
    host.check_memory(*memory(domain, len(programs), episodes.size, episodes.horizon))
    away = executor.current() if engine == "tables" else None
    if engine == "julia":
        return _play_in_lockstep(domain, programs, episodes, discount)
    if not programs:
        return _nothing(0, episodes.size)
    if any(program.parts for program in programs):
        return _play_teams(domain, programs, episodes, discount, executor.threads(workers))
    if away is not None and len(programs) * episodes.size > _WORTH:
        return _play_away(away, domain, programs, episodes, discount)
    registers = _registers(programs[0].words)
    return _play_compiled(domain, registers, episodes, discount, executor.threads(workers), _codes(programs))


_WORTH = 50_000  # episodes of programs that are worth the way to another machine: some tenths of a second


def _play_away(
    workers: Workers, domain: Domain, programs: Sequence[Program], episodes: Episodes, discount: float
) -> Played:
    """The same on the workers of :func:`harness.cluster`, so many programs a time."""
    size = max(1, _WORTH // episodes.size)
    items = [(i, _codes(programs[i : i + size])) for i in range(0, len(programs), size)]
    played = _nothing(len(programs), episodes.size)
    for (i, _), part in executor.each(
        workers, _part, items, domain, _registers(programs[0].words), episodes, discount,
        name=lambda item: f"the programs from number {item[0]:,} on, on {domain.name}",
    ):  # fmt: skip
        for whole, piece in zip(played, part, strict=True):
            whole[i : i + size] = piece
    return played


def _part(
    domain: Domain, registers: _Registers, episodes: Episodes, discount: float, item: tuple[int, _Codes]
) -> Played:
    return _play_compiled(domain, registers, episodes, discount, 1, item[1])


class _Registers(NamedTuple):
    """What compiled code needs of a domain's words."""

    of_action: NDArray[np.int16]
    numbers: NDArray[np.float64]
    n_registers: int


def _registers(words: Words) -> _Registers:
    return _Registers(words.register, words.numbers, len(words.checks))


class _Codes(NamedTuple):
    """P programs, one after the other."""

    code: Records
    lengths: NDArray[np.int64]
    """(P,)"""
    loops: NDArray[np.bool_]
    believe: NDArray[np.bool_]
    """Whether a program asks for the belief."""


def _codes(programs: Sequence[Program]) -> _Codes:
    code = np.frombuffer(b"".join([program.code.tobytes() for program in programs]), INSTRUCTION)
    lengths = np.array([len(program.code) for program in programs])
    loops = np.array([program.loop for program in programs])
    return _Codes(code, lengths, loops, np.logical_or.reduceat(code["op"] == BELIEF, np.cumsum(lengths) - lengths))


def memory(domain: Domain, programs: int, episodes: int, horizon: int) -> tuple[str, int]:
    """What :func:`play` is asked for, in words, and about how many bytes it takes."""
    each = programs + horizon + 1 + domain.n_marginals + _COLUMNS
    return f"to play {programs:,} programs in {episodes:,} episodes of {horizon:,} steps", 8 * episodes * each


_COLUMNS = 12  # numbers of 8 bytes that an episode takes besides its returns, random numbers and belief


def _play_compiled(
    domain: Domain, registers: _Registers, episodes: Episodes, discount: float, workers: int, programs: _Codes
) -> Played:
    count = len(programs.lengths)
    played = _nothing(count, episodes.size)
    last = np.cumsum(programs.lengths)
    first = last - programs.lengths
    u, start = _started(domain, episodes, bool(programs.believe.any()))

    def run(chunk: slice) -> None:
        play_together(
            domain.tables,
            domain.sure,
            u,
            discount,
            start.visible,
            start.values,
            start.observation,
            start.marginals,
            domain.visible_values,
            domain.factor_of,
            domain.nothing,
            registers.of_action,
            registers.numbers,
            registers.n_registers,
            programs.code,
            first[chunk],
            last[chunk],
            programs.loops[chunk],
            *played.part(chunk),
        )

    _in_chunks(run, count, workers)
    return played


def _play_teams(
    domain: Domain, programs: Sequence[Program], episodes: Episodes, discount: float, workers: int
) -> Played:
    """The same of programs with a section for each agent."""
    if not all(program.parts for program in programs):
        raise PolicyError("programs that are played together have all a section for each agent, or none has")
    played, none = _nothing(len(programs), episodes.size), domain.nothing
    agents, sections = teams.agents_of(programs[0].words), teams.sections_of(programs)
    u, start = _started(domain, episodes, track=False)

    def run(chunk: slice) -> None:
        teams.play(domain, agents, sections.part(chunk), u, discount, none, start, *played.part(chunk))

    _in_chunks(run, len(programs), workers)
    return played


def _started(domain: Domain, episodes: Episodes, track: bool) -> tuple[NDArray[np.float64], TablesEngine]:
    """The episodes' random numbers (horizon + 1, E), and an engine that stands at their starts."""
    u = uniform_table(np.uint64(episodes.seed), rng.ENGINE, episodes.first, episodes.size, episodes.horizon + 1)
    start = TablesEngine(domain, episodes.size, track)
    start.reset(u[0])
    return u, start


def _in_chunks(run: Callable[[slice], None], count: int, workers: int) -> None:
    chunks = [slice(i, i + _CHUNK) for i in range(0, count, _CHUNK)]
    if workers == 1 or len(chunks) == 1:
        for chunk in chunks:
            run(chunk)
    else:
        with ThreadPoolExecutor(workers) as pool:
            list(pool.map(run, chunks))


_CHUNK = 16  # programs a task: programs differ in length, so the threads take several small tasks


def _play_in_lockstep(domain: Domain, programs: Sequence[Program], episodes: Episodes, discount: float) -> Played:
    """The same through the engine contract, step by step."""
    played = _nothing(len(programs), episodes.size)
    for p, program in enumerate(programs):
        _lockstep(domain, program, episodes, discount, played.part(slice(p, p + 1)))
    return played


def _lockstep(domain: Domain, program: Program, episodes: Episodes, discount: float, played: Played) -> None:
    """Adds up what becomes of one program."""
    weight = 1.0
    policy, every, none = policy_of(program), np.arange(episodes.size), domain.nothing
    places = []  # of episode and visible value; an episode that has ended stays where it is
    for record in simulate(domain, policy, "julia", episodes.seed, episodes.first, episodes.size, episodes.horizon):
        places.append(every * domain.n_visible + record.batch.visible)
        if record.actions is not None:
            played.returns[0, record.active] += weight * record.rewards[record.active]
            weight *= discount
            played.steps[0] += int(record.active.sum())
            told = record.batch.observation[record.active]
            played.readings[0] += int(((told >= 0) & (told != none)).sum())
    played.visited[0] = len(np.unique(places))
