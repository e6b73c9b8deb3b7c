"""Programs with a section for each agent, played from start to end in one compiled loop."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.engine.tables import TablesEngine
from harness.model.agents import action_strides
from harness.model.domain import Domain
from harness.model.indexing import strides
from harness.model.tables import STOP, Records, Tables, compiled, draw_outcome, draw_reading, row_of
from harness.program import Program, Words
from harness.program.machine import next_action


class Agents(NamedTuple):
    """What compiled code needs of n agents' words; what one has less of than others is filled up."""

    action_stride: NDArray[np.int64]
    """(n,) by how much the joint action's index grows with an own one."""
    observation_stride: NDArray[np.int64]
    observation_size: NDArray[np.int64]
    register: NDArray[np.int16]
    """(n, most actions)"""
    numbers: NDArray[np.float64]
    """(n, 2, most observations)"""
    n_registers: int


class Sections(NamedTuple):
    """P programs of n sections, one after the other."""

    code: Records
    first: NDArray[np.int64]
    """(P, n)"""
    last: NDArray[np.int64]
    loop: NDArray[np.bool_]

    def part(self, chunk: slice) -> Sections:
        """Those of some programs."""
        return Sections(self.code, self.first[chunk], self.last[chunk], self.loop[chunk])


def agents_of(words: Words) -> Agents:
    """Of the words of a domain with agents."""
    domain = words.domain
    sizes = [len(agent.observations) for agent in domain.agents]
    return Agents(
        action_strides(domain),
        strides(sizes),
        np.array(sizes, dtype=np.int64),
        _filled([own.register for own in words.agents], -1),
        _filled([own.numbers for own in words.agents], np.nan),
        max(len(own.checks) for own in words.agents),
    )


def _filled(arrays: Sequence[NDArray[Any]], value: float) -> NDArray[Any]:
    """(n, …) arrays that differ in the length of their last axis only."""
    most = max(array.shape[-1] for array in arrays)
    made = np.full((len(arrays), *arrays[0].shape[:-1], most), value, dtype=arrays[0].dtype)
    for whole, array in zip(made, arrays, strict=True):
        whole[..., : array.shape[-1]] = array
    return made


def sections_of(programs: Sequence[Program]) -> Sections:
    """The sections of programs."""
    lengths = np.array([[len(part.code) for part in program.parts] for program in programs])
    last = lengths.cumsum().reshape(lengths.shape)
    loop = np.array([[part.loop for part in program.parts] for program in programs])
    return Sections(np.concatenate([program.code for program in programs]), last - lengths, last, loop)


def play(
    domain: Domain,
    agents: Agents,
    sections: Sections,
    u: NDArray[np.float64],
    discount: float,
    none: int,
    start: TablesEngine,
    returns: NDArray[np.float64],
    steps: NDArray[np.int64],
    visited: NDArray[np.int64],
    readings: NDArray[np.int64],
) -> None:
    """Play every program in every episode (:func:`harness.play.population.play`), from ``start``, on numbers ``u``."""
    _play(
        domain.tables, u, discount, start.visible, start.values, start.observation, start.done, domain.n_visible, none,
        *agents, *sections, returns, steps, visited, readings,
    )  # fmt: skip


@compiled
def _play(
    t: Tables,
    u: NDArray[np.float64],
    discount: float,
    start_visible: NDArray[np.int32],
    start_values: NDArray[np.int16],
    start_observation: NDArray[np.int32],
    start_done: NDArray[np.bool_],
    n_visible: int,
    none: int,
    action_stride: NDArray[np.int64],
    observation_stride: NDArray[np.int64],
    observation_size: NDArray[np.int64],
    register: NDArray[np.int16],
    numbers: NDArray[np.float64],
    n_registers: int,
    code: Records,
    first: NDArray[np.int64],
    last: NDArray[np.int64],
    loop: NDArray[np.bool_],
    returns: NDArray[np.float64],
    steps: NDArray[np.int64],
    visited: NDArray[np.int64],
    readings: NDArray[np.int64],
) -> None:
    choices, rows, outcomes, n_actions, reading_cdf = t.choices, t.rows, t.outcomes, t.n_actions, t.reading_cdf
    n = first.shape[1]
    place, act = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int64)
    registers = np.zeros((n, n_registers), dtype=np.int32)
    values = np.zeros((1, start_values.shape[1]), dtype=np.int16)
    no_belief, nothing_visible = np.zeros((n, 0)), np.zeros((1, 0), dtype=np.int16)
    met = np.full(n_visible, -1, dtype=np.int64)  # the last episode that has been there
    for p in range(len(first)):
        for e in range(u.shape[1]):
            v, o, done = start_visible[e], start_observation[e], start_done[e]
            for k in range(values.shape[1]):
                values[0, k] = start_values[e, k]
            place[:], registers[:] = 0, -1
            total, weight, step = 0.0, 1.0, 1
            met[v], episode = p * u.shape[1] + e, p * u.shape[1] + e
            visited[p] += 1
            while step < u.shape[0] and not done:
                va, stopped = v * n_actions, False
                for i in range(n):
                    own = -1 if o < 0 else o // observation_stride[i] % observation_size[i]
                    act[i], place[i] = next_action(
                        code, first[p, i], last[p, i], place[i], loop[p, i], no_belief, registers, i, own, numbers[i],
                        nothing_visible, 0,
                    )  # fmt: skip
                    stopped |= act[i] == STOP
                    va += act[i] * action_stride[i]
                if stopped:
                    break
                j, left = draw_outcome(rows, outcomes, row_of(choices, va, values, 0), u[step, e])
                o = draw_reading(reading_cdf, outcomes[j].reading, left)
                if choices[va].factor >= 0:
                    values[0, choices[va].factor] = outcomes[j].value
                total += weight * outcomes[j].reward
                weight *= discount
                steps[p] += 1
                v, done = outcomes[j].visible, outcomes[j].ends
                if met[v] != episode:
                    met[v] = episode
                    visited[p] += 1
                readings[p] += o >= 0 and o != none
                for i in range(n):
                    if register[i, act[i]] >= 0:
                        registers[i, register[i, act[i]]] = o // observation_stride[i] % observation_size[i]
                step += 1
            returns[p, e] = total
