"""A domain of plain NumPy arrays."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from harness.errors import HarnessError, quoted
from harness.formats import limits
from harness.formats.assembling import assemble
from harness.formats.network import Columns, Network, Variable
from harness.formats.rules import ANY, Rules
from harness.model.domain import Domain
from harness.model.validation import LARGEST_REWARD, is_name


def from_arrays(
    T: ArrayLike,
    O: ArrayLike,  # noqa: E741  # as the field writes it
    R: ArrayLike,
    b0: ArrayLike,
    discount: float,
    *,
    states: Sequence[str] | None = None,
    actions: Sequence[str] | None = None,
    observations: Sequence[str] | None = None,
    name: str = "arrays",
) -> Domain:
    """A domain of plain arrays, of S states, A actions and O observations.

    Args:
        T: (A, S, S) probability of the next state, by action and state.
        O: (A, S, O) probability of the observation, by action and next state.
        R: (A, S), (A, S, S) or (A, S, S, O) reward by action, state, next state and observation. Where it depends on
            the observation, what is expected of it is kept, which changes no policy's value.
        b0: (S,) probability of the first state.
        discount: above 0, and 1 at most.
        states: names of the states; ``s0``, ``s1``, … by default, and so with ``a`` and ``o`` below.
        actions: names of the actions.
        observations: names of the observations.
        name: the domain's name.

    States from which nothing is ever paid are the end of an episode.

    Raises:
        HarnessError: shapes do not agree, a distribution does not sum to 1, or a number is none.
    """
    t, o, r, b = (_numbers(what, array) for what, array in (("T", T), ("O", O), ("R", R), ("b0", b0)))
    if t.ndim != 3 or o.ndim != 3 or not 2 <= r.ndim <= 4:
        raise HarnessError("T has the axes (A, S, S), O (A, S, O), R (A, S), (A, S, S) or (A, S, S, O)")
    sizes = (*t.shape[:2], t.shape[1], o.shape[2])
    for what, array, shape in (
        ("T", t, sizes[:3]),
        ("O", o, (*sizes[:2], sizes[3])),
        ("b0", b, sizes[1:2]),
        ("R", r, sizes[: r.ndim]),
    ):
        if array.shape != shape:
            raise HarnessError(f"{what} has the shape {array.shape}, needed is {shape}, as T and O say")
    limits.check(f"{name}: states", sizes[1], limits.LARGEST_FACTOR, "make the model smaller")
    if not is_name(name) or not isinstance(discount, (int, float)) or not 0 < discount <= 1:
        raise HarnessError(
            f"{quoted(name)} or {quoted(discount)}: a printable name, and a discount in (0, 1], are needed"
        )
    c = Columns(1, 1, 1)
    before, after, action, reading = c.before(0), c.after(0), c.action(0), c.reading(0)
    network = Network(
        name, float(discount), (Variable("action", _names("actions", actions, sizes[0])),),
        (Variable("state", _names("states", states, sizes[1])),),
        (Variable("observation", _names("observations", observations, sizes[3])),),
        (_rules(b, [before]).distribution(),), (_rules(t, [action, before, after]).distribution(),),
        (_rules(o, [action, after, reading]).distribution(),),
        (_rules(r, [action, before, after, reading][: r.ndim]).value(),),
    )  # fmt: skip
    return assemble(network, name, "from arrays")


def _numbers(what: str, array: ArrayLike) -> NDArray[np.float64]:
    try:
        numbers = np.asarray(array, dtype=np.float64)
    except (TypeError, ValueError):
        raise HarnessError(f"{what} is no array of numbers") from None
    if not (np.abs(numbers) <= LARGEST_REWARD).all():
        raise HarnessError(f"{what} has entries that are no numbers, or over {LARGEST_REWARD:g}")
    return numbers + 0.0  # no -0.0


def _names(what: str, names: Sequence[str] | None, count: int) -> tuple[str, ...]:
    if names is None:
        return tuple(f"{what[0]}{i}" for i in range(count))
    if len(names) != count or len(set(names)) != count or not all(map(is_name, names)) or not count:
        raise HarnessError(f"{what} needs {count:,} different printable names, one for each")
    return tuple(names)


def _rules(array: NDArray[np.float64], columns: Sequence[int]) -> Rules:
    """An array as rules, one for each number that is not 0."""
    rules, axes = Rules(columns, array.shape), list(range(array.ndim))
    rules.add_many([ANY] * array.ndim, axes, np.array(np.nonzero(array)), array[array != 0], 0)
    return rules
