"""The interpreter: one program, one episode, up to its next operation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness.model.tables import STOP, Records, inlined
from harness.program.words import (
    ACT,
    AGAIN,
    AND,
    BELIEF,
    BELOW,
    ELSE,
    EQUAL,
    IF,
    NOT,
    OR,
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
            elif op in (IF, WHILE):
                if truths & 1 == 0:
                    pc += line.jump
                truths >>= 1
            elif op in (ELSE, AGAIN):
                pc += line.jump
            elif op == NOT:
                truths ^= 1
            elif op == AND:
                truths = (truths >> 1) & ((truths & 1) | -2)
            elif op == OR:
                truths = (truths >> 1) | (truths & 1)
            else:
                if op == BELIEF:
                    x = marginals[e, line.arg]
                elif op == VISIBLE:
                    x = float(visible_values[v, line.arg])
                elif op == REGISTER:
                    x = float(registers[e, line.arg])
                elif observation < 0:
                    x = np.nan
                else:
                    x = numbers[line.arg, observation]
                if line.compare == EQUAL:
                    true = x == line.value
                elif line.compare == BELOW:
                    true = x < line.value
                else:
                    true = x > line.value
                truths = (truths << 1) | int(true)
    return action, pc
