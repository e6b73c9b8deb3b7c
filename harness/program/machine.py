"""The interpreter: one program, one episode, up to its next operation."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.model.tables import STOP, Records, inlined, lean
from harness.program.words import (
    ACT,
    AGAIN,
    AND,
    AT,
    BELIEF,
    BELOW,
    ELSE,
    EQUAL,
    IF,
    NOT,
    REGISTER,
    VISIBLE,
    WHILE,
)

LIMIT = 1000
"""Instructions without an operation after which a program is stopped (SPEC section 4)."""


@inlined
def next_action(
    code: Records,
    first: int,
    last: int,
    pc: int,
    loop: bool,
    marginals: NDArray[np.float64],
    registers: NDArray[np.int32] | NDArray[np.int64],
    e: int,
    observation: int,
    numbers: NDArray[np.float64],
    visible_values: NDArray[np.int16],
    v: int,
) -> tuple[int, int]:
    """Run ``code[first:last]`` from ``pc`` (relative to ``first``); the next action and where to go on after it.

    At its end, and after :data:`LIMIT` instructions without an operation, the action is STOP.
    ``marginals[e]`` is the belief, ``registers[e]`` the last reading (or −1) of every check.
    """
    action = STOP
    truths = 0  # a stack of truth values, the top one in the lowest bit
    left = LIMIT
    n = last - first
    while left > 0:
        left -= 1
        if pc == n:
            if loop:
                pc = 0
            else:
                left = 0
        else:
            line = code[first + pc]
            op = line.op
            pc += 1
            if op == ACT:
                action = line.arg
                left = 0
            elif op < BELIEF:
                pc, truths = control(line, pc, truths)
            else:
                x = quantity(line, marginals, registers, e, observation, numbers, visible_values, v)
                truths = (truths << 1) | int(holds(line, x))
    return action, pc


@lean
def control(line: Any, pc: int, truths: int) -> tuple[int, int]:
    """Where an instruction that neither acts nor asks for a quantity goes on, and the truth values then."""
    op = line.op
    if op in (IF, WHILE):
        if truths & 1 == 0:
            pc += line.jump
        truths >>= 1
    elif op in (ELSE, AGAIN):
        pc += line.jump
    elif op == NOT:
        truths ^= 1
    elif op == AND:
        truths = (truths >> 1) & ((truths & 1) | -2)
    else:  # OR
        truths = (truths >> 1) | (truths & 1)
    return pc, truths


@lean
def quantity(
    line: Any,
    marginals: NDArray[np.float64],
    registers: NDArray[np.int32] | NDArray[np.int64],
    e: int,
    observation: int,
    numbers: NDArray[np.float64],
    visible_values: NDArray[np.int16],
    v: int,
) -> float:
    """What an instruction compares."""
    if line.op == BELIEF:
        return float(marginals[e, line.arg])
    if line.op == VISIBLE:
        return float(visible_values[v, line.arg])
    if line.op == AT:
        return float(v)
    if line.op == REGISTER:
        return float(registers[e, line.arg])
    if observation < 0:
        return np.nan
    return float(numbers[line.arg, observation])


@lean
def holds(line: Any, x: float) -> bool:
    """Whether its comparison is true."""
    if line.compare == EQUAL:
        return bool(x == line.value)
    if line.compare == BELOW:
        return bool(x < line.value)
    return bool(x > line.value)
