"""The engine's random numbers one by one, for episodes that stand at different steps.

:func:`harness.engine.rng.uniforms` gives the numbers of many episodes at one step. Where every episode has a step of
its own (an environment that restarts each when it ends), compiled code needs the number of one (seed, stream, step,
episode). It is the same number, bit for bit: Philox4x64 with ten rounds, as in NumPy (Salmon, Moraes, Dror and Shaw,
"Parallel random numbers: as easy as 1, 2, 3", SC 2011, section 3.3 and table 2).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from harness.model.tables import compiled, inlined

_ROUNDS = 10
_M0, _M1 = np.uint64(0xD2E7470EE14C6C93), np.uint64(0xCA5A826395121157)  # multipliers
_W0, _W1 = np.uint64(0x9E3779B97F4A7C15), np.uint64(0xBB67AE8584CAA73B)  # what the key grows by in a round
_ONE, _TWO, _THREE, _SHIFT, _STREAM = (np.uint64(n) for n in (1, 2, 3, 11, 32))
_UNIT = 1.0 / (1 << 53)
_BLOCK = 4  # numbers that one value of the counter gives


def _high(_: Any, a: Any, b: Any) -> Any:
    """The upper 64 bits of a 128-bit product, for which NumPy and Numba have no word."""

    def build(__: Any, builder: Any, ___: Any, arguments: Any) -> Any:
        wide = ir.IntType(128)
        left, right = (builder.zext(x, wide) for x in arguments)
        return builder.trunc(builder.lshr(builder.mul(left, right), ir.Constant(wide, 64)), ir.IntType(64))

    return types.uint64(types.uint64, types.uint64), build


_upper: Any = intrinsic(_high)


@inlined
def uniform(seed: np.uint64, stream: int, step: int, episode: int) -> float:
    """The number in [0, 1) that ``rng.uniforms(seed, stream, step, episode, 1)`` holds; ``stream`` below 2³¹."""
    number = np.uint64(episode)
    c0, c1, c2, c3 = _block(seed, stream, step, number >> _TWO)
    place = number & _THREE
    word = c0 if place == 0 else c1 if place == 1 else c2 if place == 2 else c3
    return float(word >> _SHIFT) * _UNIT


@compiled
def uniform_table(seed: np.uint64, stream: int, first: int, count: int, steps: int) -> NDArray[np.float64]:
    """(steps, count) the numbers ``rng.uniforms(seed, stream, step, first, count)`` of the steps from 0 on."""
    found = np.empty((steps, count + 2 * _BLOCK))
    for step in range(steps):
        for b in range(first // _BLOCK, (first + count - 1) // _BLOCK + 1):
            at = b * _BLOCK - first + _BLOCK  # a block may begin before the first episode
            c0, c1, c2, c3 = _block(seed, stream, step, np.uint64(b))
            found[step, at] = float(c0 >> _SHIFT) * _UNIT
            found[step, at + 1] = float(c1 >> _SHIFT) * _UNIT
            found[step, at + 2] = float(c2 >> _SHIFT) * _UNIT
            found[step, at + 3] = float(c3 >> _SHIFT) * _UNIT
    return found[:, _BLOCK : _BLOCK + count]


@inlined
def _block(seed: np.uint64, stream: int, step: int, number: np.uint64) -> tuple[np.uint64, ...]:
    """The words of four episodes, the first of which has four times the given number."""
    key0, key1 = seed, (np.uint64(stream) << _STREAM) | np.uint64(step)
    # NumPy counts on before it makes a block, so the first block is that of counter 1.
    c0, c1, c2, c3 = number + _ONE, np.uint64(0), np.uint64(0), np.uint64(0)
    for _ in range(_ROUNDS):
        high0, low0 = _upper(_M0, c0), _M0 * c0
        high1, low1 = _upper(_M1, c2), _M1 * c2
        c0, c1, c2, c3 = high1 ^ c1 ^ key0, low1, high0 ^ c3 ^ key1, low0
        key0 += _W0
        key1 += _W1
    return c0, c1, c2, c3
