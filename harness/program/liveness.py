"""What a program may yet ask for, by place: backward data flow over its instructions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness.model.tables import Records, compiled
from harness.program.words import ACT, AGAIN, BELIEF, ELSE, IF, REGISTER, WHILE


@compiled
def live(
    code: Records,
    loop: bool,
    register: NDArray[np.int16],
    n_registers: int,
    factor_of: NDArray[np.int64],
    n_factors: int,
) -> NDArray[np.bool_]:
    """(n + 1, registers + factors) whether a register, or the belief over a factor, may be read from a place on.

    The place of an operation already counts its reading as taken: a register that it fills is dead there, and just
    after it too, where nothing asks for it. (Aho, Lam, Sethi, Ullman, Compilers, section 9.2.5.)
    """
    n = len(code)
    found = np.zeros((n + 2, n_registers + n_factors), dtype=np.bool_)  # row n + 1 stays empty: the end
    changed = True
    while changed:
        changed = False
        for i in range(n, -1, -1):
            first, second = _next(code, loop, n, i)
            for c in range(found.shape[1]):
                yet = found[first, c] or found[second, c]
                if i < n and code[i].op == ACT and c == register[code[i].arg]:
                    yet = False
                if i < n and code[i].op == REGISTER and c == code[i].arg:
                    yet = True
                if i < n and code[i].op == BELIEF and c == n_registers + factor_of[code[i].arg]:
                    yet = True
                if yet and not found[i, c]:
                    found[i, c] = changed = True
    return found[: n + 1]


@compiled
def _next(code: Records, loop: bool, n: int, i: int) -> tuple[int, int]:
    """The places that may follow; n + 1 stands for the program's end."""
    if i == n:
        return (0 if loop else n + 1), n + 1
    op, jump = code[i].op, code[i].jump
    if op in (IF, WHILE):
        return i + 1, i + 1 + jump
    if op in (ELSE, AGAIN):
        return i + 1 + jump, n + 1
    return i + 1, n + 1
