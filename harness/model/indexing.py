"""Numbers of combinations of values, and spans of consecutive numbers in flat arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray


def strides(sizes: Sequence[int] | NDArray[np.int64]) -> NDArray[np.int64]:
    """(K,) by how much the number of a combination grows with each of K values; the last one runs fastest."""
    return np.cumprod([*sizes, 1][::-1])[::-1][1:].astype(np.int64)


def spans(first: NDArray[Any], count: NDArray[Any]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The numbers ``first … first + count − 1`` of one span after the other, and of which span each is."""
    which = np.repeat(np.arange(len(count)), count)
    before = np.cumsum(count) - count
    return np.arange(len(which)) + (first - before)[which], which
