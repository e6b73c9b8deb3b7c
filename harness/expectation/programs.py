"""Exact returns of many programs, in one compiled loop: what :func:`harness.expectation.forward.exact` gives for each.

It takes the same steps on the same numbers; only the program's place in the language's interpreter is reached without
a policy object in between.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.expectation.expanding import expand, ways
from harness.expectation.merging import merge
from harness.expectation.situations import SEEN, first_layer
from harness.model.domain import Domain
from harness.model.tables import STOP, Records, Tables, compiled
from harness.program import Program
from harness.program.liveness import live
from harness.program.machine import next_action

_CHUNK = 8  # programs a task: programs differ in width, so the threads take several small tasks


class Expected(NamedTuple):
    """Of P programs."""

    returns: NDArray[np.float64]
    """(P,) expected return, of the domain's shaping; NaN for programs with too many situations."""
    situations: NDArray[np.int64]
    """(P,) expanded over all steps."""


def expected(
    domain: Domain, programs: Sequence[Program], horizon: int, room: int, workers: int = 1, discount: float = 1.0
) -> Expected:
    """Exact returns of programs.

    Args:
        domain: all programs must have been compiled for it.
        programs: the programs.
        horizon: steps after which an episode is truncated.
        room: a program that needs more situations in a step is given up; so is one with a section for each agent, which
            only :func:`harness.exact` knows.
        workers: threads; the numbers do not depend on it.
        discount: what a reward loses with every step.
    """
    found = Expected(np.full(len(programs), np.nan), np.zeros(len(programs), dtype=np.int64))
    alone = [i for i, program in enumerate(programs) if not program.parts]
    if len(alone) < len(programs):
        some = expected(domain, [programs[i] for i in alone], horizon, room, workers, discount)
        found.returns[alone], found.situations[alone] = some
        return found
    if not programs:
        return found
    lengths = np.array([len(program.code) for program in programs])
    code, last = np.concatenate([program.code for program in programs]), np.cumsum(lengths)
    loop = np.array([program.loop for program in programs])
    words, begin = programs[0].words, first_layer(domain)
    factor_of, reached = domain.factor_of, ways(domain.tables)
    alive = ~domain.tables.terminal[begin.key[:, 0] // SEEN]
    key, mass = begin.key[alive], begin.mass[alive]

    def run(chunk: slice) -> None:
        _expect(
            domain.tables, key, mass, domain.visible_values, words.register, words.numbers, len(words.checks),
            factor_of, len(domain.factors), reached, horizon, room, discount, code,
            (last - lengths)[chunk], last[chunk], loop[chunk], found.returns[chunk], found.situations[chunk],
        )  # fmt: skip

    chunks = [slice(i, i + _CHUNK) for i in range(0, len(programs), _CHUNK)]
    with ThreadPoolExecutor(min(workers, len(chunks))) as pool:
        list(pool.map(run, chunks))
    return found


@compiled
def _expect(
    t: Tables,
    first_key: NDArray[np.int64],
    first_mass: NDArray[np.float64],
    visible_values: NDArray[np.int16],
    register: NDArray[np.int16],
    numbers: NDArray[np.float64],
    n_registers: int,
    factor_of: NDArray[np.int64],
    n_factors: int,
    reached: NDArray[np.int64],
    horizon: int,
    room: int,
    discount: float,
    code: Records,
    firsts: NDArray[np.int64],
    lasts: NDArray[np.int64],
    loops: NDArray[np.bool_],
    returns: NDArray[np.float64],
    situations: NDArray[np.int64],
) -> None:
    memory = n_registers + 2  # place, registers and last action, as the policy keeps them
    for p in range(len(firsts)):
        program = code[firsts[p] : lasts[p]]
        may_ask = live(program, loops[p], register, n_registers, factor_of, n_factors)
        key = np.full((len(first_key), memory + first_key.shape[1]), -1, dtype=np.int64)
        key[:, 0] = 0
        key[:, memory:] = first_key
        mass = first_mass.copy()
        total, weight, step = 0.0, 1.0, 0
        while step < horizon and len(mass) > 0:
            actions = np.empty(len(mass), dtype=np.int32)
            watched = np.zeros((len(mass), n_factors), dtype=np.bool_)
            needed = 1
            for e in range(len(mass)):
                seen = key[e, memory]
                a = _act(program, loops[p], key, e, n_registers, register, numbers, visible_values, may_ask, watched)
                actions[e] = a
                if a != STOP:
                    needed += reached[seen // SEEN * t.n_actions + a]
            if needed > room:
                total, step = np.nan, horizon
                break
            situations[p] += len(mass)
            after, weights = np.empty((needed, key.shape[1]), dtype=np.int64), np.empty(needed)
            parents, rewards, ended = np.empty(needed, dtype=np.int64), np.empty(len(mass)), np.empty(len(mass))
            count = expand(t, key, mass, actions, after, weights, parents, rewards, ended)
            total += weight * rewards.sum()
            weight *= discount
            heirs = watched[parents[:count]]
            n, _ = merge(after[:count], weights[:count], heirs, t.factor_offset)
            key, mass = after[:n], weights[:n]
            step += 1
        returns[p] = total


@compiled
def _act(
    program: Records,
    loop: bool,
    key: NDArray[np.int64],
    e: int,
    n_registers: int,
    register: NDArray[np.int16],
    numbers: NDArray[np.float64],
    visible_values: NDArray[np.int16],
    may_ask: NDArray[np.bool_],
    watched: NDArray[np.bool_],
) -> int:
    """The next action of a situation; its memory moves on, and what will not be asked for is forgotten."""
    memory = n_registers + 2
    seen, last = key[e, memory], key[e, memory - 1]
    visible, reading = seen // SEEN, seen % SEEN - 1
    if last != STOP and register[last] >= 0:
        key[e, 1 + register[last]] = reading
    registers, marginals = key[:, 1 : memory - 1], key.view(np.float64)[:, memory + 1 :]
    a, place = next_action(
        program, 0, len(program), key[e, 0], loop, marginals, registers, e, reading, numbers, visible_values, visible
    )
    key[e, 0], key[e, memory - 1] = place, a
    if a != STOP:
        for r in range(n_registers):
            if not may_ask[place - 1, r]:
                key[e, 1 + r] = -1
        for k in range(watched.shape[1]):
            watched[e, k] = may_ask[place - 1, n_registers + k]
    return a
