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
from harness.engine.tables import TablesEngine
from harness.errors import PolicyError
from harness.model.domain import Domain
from harness.model.tables import (
    STOP,
    Records,
    Tables,
    compiled,
    draw_labels,
    draw_outcome,
    draw_reading,
    row_of,
    update_belief,
    update_sensed,
)
from harness.play import executor, teams
from harness.play.evaluation import simulate
from harness.play.executor import Workers
from harness.policy.team import policy_of
from harness.program import Program, Words
from harness.program.machine import next_action


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


def _codes(programs: Sequence[Program]) -> _Codes:
    return _Codes(
        np.concatenate([program.code for program in programs]),
        np.array([len(program.code) for program in programs]),
        np.array([program.loop for program in programs]),
        np.array([program.uses_belief for program in programs]),
    )


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
        _play(
            domain.tables,
            u,
            discount,
            start.visible,
            start.values,
            start.observation,
            start.done,
            start.marginals,
            domain.visible_values,
            _none(domain),
            registers.of_action,
            registers.numbers,
            registers.n_registers,
            programs.code,
            first[chunk],
            last[chunk],
            programs.loops[chunk],
            programs.believe[chunk],
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
    played, none = _nothing(len(programs), episodes.size), _none(domain)
    agents, sections = teams.agents_of(programs[0].words), teams.sections_of(programs)
    u, start = _started(domain, episodes, track=False)

    def run(chunk: slice) -> None:
        teams.play(domain, agents, sections.part(chunk), u, discount, none, start, *played.part(chunk))

    _in_chunks(run, len(programs), workers)
    return played


def _started(domain: Domain, episodes: Episodes, track: bool) -> tuple[NDArray[np.float64], TablesEngine]:
    """The episodes' random numbers (E, horizon + 1), and an engine that stands at their starts."""
    u = np.empty((episodes.size, episodes.horizon + 1))
    for step in range(episodes.horizon + 1):
        u[:, step] = rng.uniforms(episodes.seed, rng.ENGINE, step, episodes.first, episodes.size)
    start = TablesEngine(domain, episodes.size, track)
    start.reset(u[:, 0])
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


def _none(domain: Domain) -> int:
    """The observation that tells nothing; −1 where each tells something."""
    return domain.observations.index("none") if "none" in domain.observations else -1


def _play_in_lockstep(domain: Domain, programs: Sequence[Program], episodes: Episodes, discount: float) -> Played:
    """The same through the engine contract, step by step."""
    played = _nothing(len(programs), episodes.size)
    for p, program in enumerate(programs):
        _lockstep(domain, program, episodes, discount, played.part(slice(p, p + 1)))
    return played


def _lockstep(domain: Domain, program: Program, episodes: Episodes, discount: float, played: Played) -> None:
    """Adds up what becomes of one program."""
    weight = 1.0
    policy, every, none = policy_of(program), np.arange(episodes.size), _none(domain)
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


@compiled
def _play(
    t: Tables,
    u: NDArray[np.float64],
    discount: float,
    start_visible: NDArray[np.int32],
    start_values: NDArray[np.int16],
    start_observation: NDArray[np.int32],
    start_done: NDArray[np.bool_],
    start_marginals: NDArray[np.float64],
    visible_values: NDArray[np.int16],
    none: int,
    register: NDArray[np.int16],
    numbers: NDArray[np.float64],
    n_registers: int,
    code: Records,
    firsts: NDArray[np.int64],
    lasts: NDArray[np.int64],
    loops: NDArray[np.bool_],
    believes: NDArray[np.bool_],
    returns: NDArray[np.float64],
    steps: NDArray[np.int64],
    visited: NDArray[np.int64],
    readings: NDArray[np.int64],
) -> None:
    choices, rows, outcomes, n_actions = t.choices, t.rows, t.outcomes, t.n_actions
    reading_cdf, reading_probability, factor_offset = t.reading_cdf, t.reading_probability, t.factor_offset
    sensors = t.sensors
    values = np.zeros((1, start_values.shape[1]), dtype=np.int16)
    marginals = np.zeros((1, start_marginals.shape[1]))
    registers = np.zeros((1, n_registers), dtype=np.int32)
    met = np.full(len(visible_values), -1, dtype=np.int64)  # the last episode that has been there
    scratch = np.zeros(max(1, np.diff(factor_offset).max() if len(factor_offset) > 1 else 1))
    for p in range(len(firsts)):
        first, last, loop, track = firsts[p], lasts[p], loops[p], believes[p]
        cells, told = 0, 0
        for e in range(u.shape[0]):
            v, o, done = start_visible[e], start_observation[e], start_done[e]
            for k in range(values.shape[1]):
                values[0, k] = start_values[e, k]
            for k in range(n_registers):
                registers[0, k] = -1
            if track:
                for j in range(marginals.shape[1]):
                    marginals[0, j] = start_marginals[e, j]
            place, total, weight = 0, 0.0, 1.0
            episode = p * u.shape[0] + e
            met[v] = episode
            cells += 1
            step = 1
            while step < u.shape[1] and not done:
                a, place = next_action(
                    code, first, last, place, loop, marginals, registers, 0, o, numbers, visible_values, v
                )
                if a == STOP:
                    step = u.shape[1]
                else:
                    va = v * n_actions + a
                    i, left = draw_outcome(rows, outcomes, row_of(choices, va, values, 0), u[e, step])
                    o = draw_reading(reading_cdf, outcomes[i].reading, left)
                    k = choices[va].factor
                    if k >= 0:
                        values[0, k] = outcomes[i].value
                    total += weight * outcomes[i].reward
                    weight *= discount
                    steps[p] += 1
                    v = outcomes[i].visible
                    done = outcomes[i].ends
                    if met[v] != episode:
                        met[v] = episode
                        cells += 1
                    told += o >= 0 and o != none
                    if register[a] >= 0:
                        registers[0, register[a]] = o
                    if track and k >= 0:
                        start = factor_offset[k]
                        n = factor_offset[k + 1] - start
                        update_belief(
                            choices, rows, outcomes, reading_probability, va, v, o, marginals, 0, start, n, scratch
                        )
                    if sensors is not None:
                        va, q = v * n_actions + a, outcomes[i].reading
                        o = draw_labels(sensors, reading_probability, reading_cdf, q, o, left, va, values, 0)
                        if track:
                            update_sensed(sensors, factor_offset, va, o, marginals, 0, scratch)
                    step += 1
            returns[p, e] = total
        visited[p], readings[p] = cells, told
