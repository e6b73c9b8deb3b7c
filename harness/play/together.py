"""One program in many episodes at a time: those that stand alike go on together.

All episodes of a program begin at the same instruction. As long as they stand at the same instruction, step and visible
value they are one group: an instruction is decoded once for all, and a step that is sure, whatever is hidden
(:mod:`harness.model.certainty`), and whose reading nobody will ask for is taken once for all. Only what is hidden,
drawn, read or believed is kept for each episode. A group parts where a test is true in some of its episodes only, or
a step leads to different visible values; the parts are played one after the other, the last one first.

Each episode meets the operations, in the order, that it would meet alone: its numbers are the same, bit for bit.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness.model.certainty import UNSURE
from harness.model.tables import (
    Records,
    Sensors,
    Tables,
    compiled,
    draw_labels,
    draw_outcome,
    draw_reading,
    lean,
    row_of,
    update_belief,
    update_sensed,
)
from harness.program.machine import LIMIT, control, holds, quantity
from harness.program.words import ACT, AGAIN, AT, BELIEF, READING, REGISTER, VISIBLE

LANES = 256
"""Episodes at a time: so many that their numbers stay in the cache next to the core."""

_GROUP = np.dtype(
    [(name, np.int64) for name in ("first", "last", "place", "visible", "step", "left", "truths", "cells")]
)
"""Episodes ``lanes[first:last]`` that go on together: at which instruction, at which visible value, before which step,
how many instructions may yet come without an operation, the truth values so far, and how many visible values they have
seen."""


@compiled
def play_together(
    t: Tables,
    sure: Records,
    u: NDArray[np.float64],
    discount: float,
    start_visible: NDArray[np.int32],
    start_values: NDArray[np.int16],
    start_observation: NDArray[np.int32],
    start_marginals: NDArray[np.float64],
    visible_values: NDArray[np.int16],
    factor_of: NDArray[np.int64],
    none: int,
    register: NDArray[np.int16],
    numbers: NDArray[np.float64],
    n_registers: int,
    code: Records,
    firsts: NDArray[np.int64],
    lasts: NDArray[np.int64],
    loops: NDArray[np.bool_],
    returns: NDArray[np.float64],
    steps: NDArray[np.int64],
    visited: NDArray[np.int64],
    readings: NDArray[np.int64],
) -> None:
    """Play the programs ``code[firsts[p]:lasts[p]]`` in all episodes; the last four arrays are filled in.

    ``u`` (steps + 1, E) holds the random numbers, the starts' in its first row. ``start_marginals`` may be (E, 0) if no
    program asks for the belief.
    """
    choices, rows, outcomes, n_actions, terminal = t.choices, t.rows, t.outcomes, t.n_actions, t.terminal
    reading_cdf, reading_probability, factor_offset = t.reading_cdf, t.reading_probability, t.factor_offset
    sensors = t.sensors
    end, n_episodes = u.shape[0], u.shape[1]
    room = min(LANES, n_episodes)
    values = np.zeros((room, start_values.shape[1]), dtype=np.int16)
    marginals = np.zeros((room, start_marginals.shape[1]))
    registers = np.zeros((room, n_registers), dtype=np.int32)
    observed = np.zeros(room, dtype=np.int32)
    reached = np.zeros(room, dtype=np.int32)
    totals = np.zeros(room)
    lanes = np.zeros(room, dtype=np.int64)
    waiting = np.zeros(room + 1, dtype=_GROUP)
    met = np.zeros(len(visible_values), dtype=np.bool_)
    trail = np.zeros(end + 1, dtype=np.int64)  # the visible values that the group has seen, in order
    cells = 0
    scratch = np.zeros(max(1, np.diff(factor_offset).max() if len(factor_offset) > 1 else 1))
    weights = np.ones(end + 1)
    for step in range(2, end + 1):
        weights[step] = weights[step - 1] * discount
    asked_register = np.zeros(n_registers + 1, dtype=np.int64)
    asked_factor = np.zeros(len(factor_offset), dtype=np.int64)
    for p in range(len(firsts)):
        start, n, loop = firsts[p], lasts[p] - firsts[p], loops[p]
        asked_reading = last_asked(code, start, n, loop, factor_of, asked_register, asked_factor)
        track = asked_factor.max() > 0
        taken, told = 0, 0
        for before in range(0, n_episodes, LANES):
            count = min(LANES, n_episodes - before)
            begin(
                before, count, start_visible, start_values, start_observation,
                lanes, reached, values, observed, registers, totals,
            )  # fmt: skip
            if track:
                marginals[:count] = start_marginals[before : before + count]
            n_waiting = part_by_visible(waiting, 0, lanes, reached, 0, count, 0, 1, 0)
            while n_waiting > 0:
                n_waiting -= 1
                g = waiting[n_waiting]
                lo, hi, place, v, step, left, truths = g.first, g.last, g.place, g.visible, g.step, g.left, g.truths
                while cells > g.cells:
                    cells -= 1
                    met[trail[cells]] = False
                if not met[v]:
                    met[v] = True
                    trail[cells] = v
                    cells += 1
                going = step < end and not terminal[v]
                while going:
                    if left == 0 or (place == n and not loop):
                        break
                    left -= 1
                    if place == n:
                        place = 0
                        continue
                    line = code[start + place]
                    op = line.op
                    place += 1
                    if op == ACT:
                        a = line.arg
                        va = v * n_actions + a
                        k, r = choices[va].factor, register[a]
                        believed = track and ((k >= 0 and asked_factor[k] > place) or sensors is not None)
                        noted = r >= 0 and asked_register[r] > place
                        heard = asked_reading > place
                        wanted = believed or noted or sensors is not None or sure[va].told == UNSURE
                        drawn = wanted or (heard and sure[va].observation == UNSURE)
                        weight = weights[step]
                        taken += hi - lo
                        if sure[va].visible >= 0 and not drawn:
                            paid = weight * sure[va].reward
                            if paid != 0.0:
                                for j in range(lo, hi):
                                    totals[lanes[j]] += paid
                            if heard:
                                for j in range(lo, hi):
                                    observed[lanes[j]] = sure[va].observation
                            told += (hi - lo) * sure[va].told
                            v = sure[va].visible
                        else:
                            alike, more = step_each(
                                choices, rows, outcomes, reading_probability, reading_cdf, factor_offset, sensors,
                                va, n_actions, u[step], before, weight, none, sure[va].observation,
                                r if noted else -1, believed, heard, drawn,
                                lanes, lo, hi, values, totals, reached, observed, registers, marginals, scratch,
                            )  # fmt: skip
                            told += more if drawn else (hi - lo) * sure[va].told
                            if alike:
                                v = reached[lanes[lo]]
                            else:
                                n_waiting = part_by_visible(
                                    waiting, n_waiting, lanes, reached, lo, hi, place, step + 1, cells
                                )
                                hi = lo  # the parts go on
                                break
                        step += 1
                        left, truths = LIMIT, 0
                        if not met[v]:
                            met[v] = True
                            trail[cells] = v
                            cells += 1
                        going = step < end and not terminal[v]
                    elif op < BELIEF:
                        place, truths = control(line, place, truths)
                    elif op in (VISIBLE, AT):
                        x = quantity(line, marginals, registers, 0, 0, numbers, visible_values, v)
                        truths = (truths << 1) | int(holds(line, x))
                    else:
                        middle = lo
                        for j in range(lo, hi):
                            e = lanes[j]
                            x = quantity(line, marginals, registers, e, observed[e], numbers, visible_values, v)
                            lanes[j] = lanes[middle]
                            lanes[middle] = e
                            middle += int(holds(line, x))
                        truths <<= 1
                        if middle > lo:
                            if middle < hi:
                                put(waiting, n_waiting, middle, hi, place, v, step, left, truths, cells)
                                n_waiting += 1
                                hi = middle
                            truths |= 1
                visited[p] += cells * (hi - lo)
                for j in range(lo, hi):
                    returns[p, before + lanes[j]] = totals[lanes[j]]
            while cells > 0:
                cells -= 1
                met[trail[cells]] = False
        steps[p], readings[p] = taken, told


@lean
def begin(
    before: int,
    count: int,
    start_visible: NDArray[np.int32],
    start_values: NDArray[np.int16],
    start_observation: NDArray[np.int32],
    lanes: NDArray[np.int64],
    reached: NDArray[np.int32],
    values: NDArray[np.int16],
    observed: NDArray[np.int32],
    registers: NDArray[np.int32],
    totals: NDArray[np.float64],
) -> None:
    """The episodes from number ``before`` on, before their first step."""
    for e in range(count):
        lanes[e], reached[e], observed[e] = e, start_visible[before + e], start_observation[before + e]
        totals[e] = 0.0
        for k in range(values.shape[1]):
            values[e, k] = start_values[before + e, k]
        for k in range(registers.shape[1]):
            registers[e, k] = -1


@lean
def step_each(
    choices: Records,
    rows: Records,
    outcomes: Records,
    reading_probability: NDArray[np.float64],
    reading_cdf: NDArray[np.float64],
    factor_offset: NDArray[np.int64],
    sensors: Sensors | None,
    va: int,
    n_actions: int,
    u: NDArray[np.float64],
    before: int,
    weight: float,
    none: int,
    observation: int,
    r: int,
    believed: bool,
    heard: bool,
    drawn: bool,
    lanes: NDArray[np.int64],
    lo: int,
    hi: int,
    values: NDArray[np.int16],
    totals: NDArray[np.float64],
    reached: NDArray[np.int32],
    observed: NDArray[np.int32],
    registers: NDArray[np.int32],
    marginals: NDArray[np.float64],
    scratch: NDArray[np.float64],
) -> tuple[bool, int]:
    """Choice ``va`` in every episode of a group; whether all reach the same visible value, and how many were told
    something.

    What is observed goes to register ``r`` (−1: to none), to the belief if ``believed``, to ``observed`` if ``heard``;
    it is ``observation`` unless it is ``drawn``.
    """
    k, told, alike = choices[va].factor, 0, True
    for j in range(lo, hi):
        e = lanes[j]
        i, left = draw_outcome(rows, outcomes, row_of(choices, va, values, e), u[before + e])
        if k >= 0:
            values[e, k] = outcomes[i].value
        totals[e] += weight * outcomes[i].reward
        reached[e] = outcomes[i].visible
        alike &= reached[e] == reached[lanes[lo]]
        o = observation
        if drawn:
            o = draw_reading(reading_cdf, outcomes[i].reading, left)
            told += o >= 0 and o != none
            if r >= 0:
                registers[e, r] = o
            if believed and k >= 0:
                first = factor_offset[k]
                n = factor_offset[k + 1] - first
                update_belief(
                    choices, rows, outcomes, reading_probability, va, reached[e], o, marginals, e, first, n, scratch
                )
            if sensors is not None:
                vpa, q = reached[e] * n_actions + va % n_actions, outcomes[i].reading
                o = draw_labels(sensors, reading_probability, reading_cdf, q, o, left, vpa, values, e)
                if believed:
                    update_sensed(sensors, factor_offset, vpa, o, marginals, e, scratch)
        if heard:
            observed[e] = o
    return alike, told


@lean
def put(
    waiting: Records,
    at: int,
    first: int,
    last: int,
    place: int,
    visible: int,
    step: int,
    left: int,
    truths: int,
    cells: int,
) -> None:
    """One more group that waits."""
    g = waiting[at]
    g.first, g.last, g.place, g.visible = first, last, place, visible
    g.step, g.left, g.truths, g.cells = step, left, truths, cells


@lean
def part_by_visible(
    waiting: Records,
    n_waiting: int,
    lanes: NDArray[np.int64],
    reached: NDArray[np.int32],
    first: int,
    last: int,
    place: int,
    step: int,
    cells: int,
) -> int:
    """Put the episodes ``lanes[first:last]`` into groups by the visible values that they have reached; how many groups
    wait then."""
    while first < last:
        v, middle = reached[lanes[first]], first
        for j in range(first, last):
            e = lanes[j]
            lanes[j] = lanes[middle]
            lanes[middle] = e
            middle += int(reached[e] == v)
        put(waiting, n_waiting, first, middle, place, v, step, LIMIT, 0, cells)
        n_waiting += 1
        first = middle
    return n_waiting


@lean
def last_asked(
    code: Records,
    start: int,
    n: int,
    loop: bool,
    factor_of: NDArray[np.int64],
    asked_register: NDArray[np.int64],
    asked_factor: NDArray[np.int64],
) -> int:
    """Up to which place a program asks for each register and for the belief over each factor (0: never), filled in, and
    for the latest reading. One that goes back asks to its end for whatever it asks for."""
    back, asked_reading = loop, 0
    asked_register[:] = 0
    asked_factor[:] = 0
    for i in range(n):
        back |= code[start + i].op == AGAIN
    for i in range(n):
        op, arg = code[start + i].op, code[start + i].arg
        until = n + 1 if back else i + 1
        if op == REGISTER:
            asked_register[arg] = until
        elif op == BELIEF:
            asked_factor[factor_of[arg]] = until
        elif op == READING:
            asked_reading = until
    return asked_reading
