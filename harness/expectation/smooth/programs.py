"""A program whose comparisons of beliefs are gates: both ways are gone, each with its probability.

The constants are the program's, in the order of its text (:attr:`~harness.program.compiled.Program.constants`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness.expectation.situations import SEEN
from harness.expectation.smooth.duals import LEAST, Rows, emit, gate, room, weigh
from harness.model.tables import STOP, Records, compiled, inlined
from harness.policy.program import ProgramPolicy
from harness.program.machine import LIMIT, control, holds, quantity
from harness.program.words import ACT, BELIEF, BELOW, EQUAL


class SoftProgram:
    """:class:`harness.policy.program.ProgramPolicy` with gates."""

    def __init__(self, policy: ProgramPolicy) -> None:
        """What it remembers is place, registers and last action."""
        self._program = program = policy.program
        self._registers = len(program.words.checks)
        self.constants = len(program.constants)
        self.memory = np.full(self._registers + 2, -1, dtype=np.int64)
        self.memory[0] = 0
        self.most = 1 + int((program.code["op"] == ACT).sum())
        self._constant = np.cumsum(program.code["op"] == BELIEF) - 1

    def act(self, key: NDArray[np.int64], mass: NDArray[np.float64], temperature: float) -> tuple[Rows, int]:
        """Room with what may be done, and how many rows of it are written."""
        program, words = self._program, self._program.words
        rows = room(self.most * len(key), len(self.memory), mass.shape[1])
        visible_values = words.domain.visible_values
        live = np.ascontiguousarray(program.live[:, : self._registers])
        count = _act(
            program.code, self._constant, program.loop, words.register, words.numbers, visible_values,
            live, key, mass, temperature, rows,
        )  # fmt: skip
        return rows, count

    def watched(self, rows: Rows) -> NDArray[np.bool_]:
        """(B, K) of which factors the belief may yet be looked at."""
        return self._program.live[rows.memory[:, 0] - 1, self._registers :]


@compiled
def _act(
    code: Records,
    constant: NDArray[np.int64],
    loop: bool,
    register: NDArray[np.int16],
    numbers: NDArray[np.float64],
    visible_values: NDArray[np.int16],
    live: NDArray[np.bool_],
    key: NDArray[np.int64],
    mass: NDArray[np.float64],
    temperature: float,
    rows: Rows,
) -> int:
    width = live.shape[1] + 2
    memory, count = np.empty(width, dtype=np.int64), 0
    places, masses = np.empty((16, 3), dtype=np.int64), np.empty((16, mass.shape[1]))  # the ways that are still open
    for e in range(len(key)):
        seen, last, first = key[e, width], key[e, width - 1], count
        if last != STOP and register[last] >= 0:
            key[e, 1 + register[last]] = seen % SEEN - 1
        places[0, 0], places[0, 1], places[0, 2] = key[e, 0], 0, LIMIT
        masses[0] = mass[e]
        ways = 1
        while ways > 0:
            if ways == len(places):
                places, masses = np.concatenate((places, places)), np.concatenate((masses, masses))
            w = _hindmost(places, ways)
            action, ways = _instruction(
                code, constant, loop, numbers, visible_values, key, e, width, temperature, places, masses, ways, w
            )
            if action >= 0:
                _remember(memory, key, e, places[w, 0], action, live)
                count = emit(rows, first, count, e, action, memory, masses[w])
            if action >= 0 or places[w, 2] == 0 or masses[w, 0] < LEAST:
                ways = _close(places, masses, ways, w)
            else:
                ways = _join(places, masses, ways, w)
    return count


@inlined
def _hindmost(places: NDArray[np.int64], ways: int) -> int:
    """The way that is least far, so that ways which lead to one place meet there."""
    w = 0
    for i in range(1, ways):
        if places[i, 0] < places[w, 0]:
            w = i
    return w


@inlined
def _instruction(
    code: Records,
    constant: NDArray[np.int64],
    loop: bool,
    numbers: NDArray[np.float64],
    visible_values: NDArray[np.int16],
    key: NDArray[np.int64],
    e: int,
    width: int,
    temperature: float,
    places: NDArray[np.int64],
    masses: NDArray[np.float64],
    ways: int,
    w: int,
) -> tuple[int, int]:
    """One instruction of a way, as :func:`harness.program.machine.next_action` takes it; at a gate it becomes two.

    The action, −1 as long as there is none, and how many ways there are then.
    """
    pc, truths, action = places[w, 0], places[w, 1], STOP
    places[w, 2] -= 1
    if pc == len(code):
        places[w, 0] = 0
        if not loop:
            places[w, 2] = 0
        return action, ways
    line = code[pc]
    op = line.op
    pc += 1
    if op == ACT:
        action = line.arg
    elif op < BELIEF:
        pc, truths = control(line, pc, truths)
    elif op == BELIEF and line.compare != EQUAL:
        x = key.view(np.float64)[e, width + 1 + line.arg] - line.value
        if line.compare == BELOW:
            x = -x
        sign = 1.0 if line.compare == BELOW else -1.0  # of the derivative by the constant
        places[ways, 0], places[ways, 1], places[ways, 2] = pc, truths << 1, places[w, 2]
        shut, slope = gate(-x, temperature)
        weigh(masses[ways], masses[w], shut, -sign * slope, constant[pc - 1])
        if masses[ways, 0] >= LEAST:
            ways += 1
        opened, slope = gate(x, temperature)
        weigh(masses[w], masses[w], opened, sign * slope, constant[pc - 1])
        truths = (truths << 1) | 1
    else:
        seen = key[e, width]
        beliefs, registers = key.view(np.float64)[:, width + 1 :], key[:, 1:]
        x = quantity(line, beliefs, registers, e, seen % SEEN - 1, numbers, visible_values, seen // SEEN)
        truths = (truths << 1) | int(holds(line, x))
    places[w, 0], places[w, 1] = pc, truths
    return action, ways


@inlined
def _remember(
    memory: NDArray[np.int64], key: NDArray[np.int64], e: int, pc: int, action: int, live: NDArray[np.bool_]
) -> None:
    """Place, registers that may yet be asked for, and the action."""
    n = live.shape[1]
    memory[0], memory[n + 1] = pc, action
    for r in range(n):
        memory[1 + r] = key[e, 1 + r] if live[pc - 1, r] else -1


@inlined
def _close(places: NDArray[np.int64], masses: NDArray[np.float64], ways: int, w: int) -> int:
    """Without one of the ways; the last one takes its place."""
    places[w], masses[w] = places[ways - 1], masses[ways - 1]
    return ways - 1


@inlined
def _join(places: NDArray[np.int64], masses: NDArray[np.float64], ways: int, w: int) -> int:
    """Ways of one place and equal truths are one."""
    for i in range(ways - 1, -1, -1):
        if i != w and places[i, 0] == places[w, 0] and places[i, 1] == places[w, 1]:
            for c in range(masses.shape[1]):
                masses[w, c] += masses[i, c]
            places[w, 2] = max(places[w, 2], places[i, 2])
            if w == ways - 1:  # it moves into the gap
                places[i], masses[i] = places[w], masses[w]
                return ways - 1
            return _close(places, masses, ways, i)
    return ways
