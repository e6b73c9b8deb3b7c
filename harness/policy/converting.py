"""Programs as finite-state controllers: a node for all that a program may remember."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness.errors import PolicyError
from harness.model.domain import Domain
from harness.model.tables import STOP, Records, compiled
from harness.policy.fsc import Nodes
from harness.program import Program
from harness.program.machine import next_action

MOST_NODES = 10_000
_UNHEARD = -2  # in place of the last action, where nobody will ask what was read after it


def controller_of(program: Program, domain: Domain) -> Nodes:
    """The controller that acts as a program does, of at most 10,000 nodes.

    A node is a place in the program with the readings that may yet be asked for from there on. What a program asks of
    the belief is no finite memory.

    Raises:
        PolicyError: the program asks for beliefs, remembers too much, or has a section for each agent.
    """
    if program.parts:
        raise PolicyError("the program has a section for each agent, whose controllers are several; take one section")
    if program.uses_belief:
        raise PolicyError("the program asks for beliefs, which no finite memory holds; its readings alone may decide")
    start = (0, STOP, *[-1] * len(program.words.checks))  # place, last action, readings
    numbers, action, following = {start: 0}, [], []
    for memory in (waiting := [start]):
        does, after = _node(program, domain, np.array(memory, dtype=np.int64))
        ways, which = np.unique(after.reshape(-1, after.shape[2]), axis=0, return_inverse=True)
        for way in map(tuple, ways.tolist()):
            if way not in numbers:
                numbers[way] = len(numbers)
                waiting.append(way)
        if len(numbers) > MOST_NODES:
            raise PolicyError(f"the program remembers more than {MOST_NODES:,} nodes of a controller hold")
        action.append(does)
        following.append(np.array([numbers[way] for way in map(tuple, ways.tolist())])[which].reshape(does.shape))
    return Nodes(0, np.array(action, dtype=np.int32), np.array(following, dtype=np.int32))


def _node(program: Program, domain: Domain, memory: NDArray[np.int64]) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """(V, O + 1) what is done by what is seen, and (V, O + 1, memory) what is then remembered."""
    words = program.words
    shape = domain.n_visible, domain.n_observations + 1
    actions, after = np.full(shape, STOP, dtype=np.int32), np.tile(memory, (*shape, 1))
    _run(
        program.code, program.loop, words.register, words.numbers, domain.visible_values, domain.tables.terminal,
        program.live, actions, after,
    )  # fmt: skip
    return actions, after


@compiled
def _run(
    code: Records,
    loop: bool,
    register: NDArray[np.int16],
    numbers: NDArray[np.float64],
    visible_values: NDArray[np.int16],
    terminal: NDArray[np.bool_],
    live: NDArray[np.bool_],
    actions: NDArray[np.int32],
    after: NDArray[np.int64],
) -> None:
    """On to the next operation from everything that may be seen; ``after`` holds the memory before it, and keeps it
    where nothing is done: at the end, and for what is never met."""
    nothing = np.zeros((1, 1))  # of beliefs, which the program does not ask for
    place, last = after[0, 0, 0], after[0, 0, 1]
    for v in range(len(actions)):
        for o in range(0 if last != STOP else -1, actions.shape[1] - 1):
            if terminal[v]:
                continue
            registers = after[v, o + 1 : o + 2, 2:]
            if last >= 0 and o >= 0:
                registers[0, register[last]] = o
            a, then = next_action(code, 0, len(code), place, loop, nothing, registers, 0, o, numbers, visible_values, v)
            actions[v, o + 1] = a
            if a != STOP:
                for r in range(registers.shape[1]):
                    if not live[then - 1, r]:
                        registers[0, r] = -1
                after[v, o + 1, 0] = then
                after[v, o + 1, 1] = a if register[a] >= 0 and live[then, register[a]] else _UNHEARD
