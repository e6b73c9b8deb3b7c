"""The policy protocol."""

from __future__ import annotations

import copy
import threading
import warnings
from collections.abc import Iterable
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from harness.engine.batch import Batch
from harness.errors import PolicyError, quoted
from harness.model.tables import STOP


@runtime_checkable
class Policy(Protocol):
    """Decides for a whole batch of episodes at a time. Any object with these two methods is a policy.

    Every batch of episodes is played by a copy of its own (:func:`fresh`), so that batches can run at the same time and
    the object given stays as it was. What a policy remembers of its episodes must be made anew in :meth:`reset`, as
    arrays with one row an episode, and random choices come from :meth:`harness.engine.batch.Batch.uniform`: a generator
    of the policy's own would start again in every batch. :func:`harness.check_policy` finds what is missing.

    A policy that cannot be deep-copied, or not cheaply, may have a method ``clone()`` that returns an independent copy
    and leaves the policy as it is.

    A policy that never looks at the belief may set a class attribute ``uses_belief = False``; the engine then
    leaves the belief out, which is faster. One that takes long over a decision may set ``batch_size`` (episodes a
    batch) and ``max_episodes`` (what a comparison gives it unless told otherwise).

    A policy without random choices may say in ``memory`` by which attributes it remembers: arrays with one row an
    episode, made in :meth:`reset`, that :meth:`act` changes or replaces; ``()`` for none. What it earns can then be
    computed instead of sampled (:func:`harness.exact`).
    """

    def reset(self, batch: Batch) -> None:
        """Begin new episodes: ``batch`` shows them before the first step."""

    def act(self, batch: Batch) -> NDArray[Any]:
        """Action indices (E,), whole numbers; those of ended episodes are ignored.

        −1 (:data:`harness.model.tables.STOP`) ends an episode's part in the evaluation where it stands: no more steps,
        no more reward, no success. Whoever returns it must go on returning it for that episode.
        """


class Stateless:
    """A policy that remembers nothing between steps."""

    memory: tuple[str, ...] = ()

    def reset(self, batch: Batch) -> None:
        """Nothing to forget."""


def copied(policy: Policy) -> Policy:
    """An independent copy, by the policy's own ``clone()`` where it has one, else a deep one.

    Raises:
        PolicyError: it cannot be copied.
    """
    clone = getattr(policy, "clone", None)
    try:
        with _COPYING:
            made = copy.deepcopy(policy) if clone is None else clone()
        if not isinstance(made, Policy):
            raise TypeError(f"clone() returned a {type(made).__name__}")
        if made is policy:
            raise TypeError("its copy is the policy itself")
    except Exception as error:
        name, why = type(policy).__name__, f"{type(error).__name__}: {error}"
        raise PolicyError(
            f"{name} cannot be copied ({' '.join(why.split())[:60]}): it plays in one thread, on the object itself, "
            "until it has a method clone() that returns an independent copy"
        ) from error
    return made


_COPYING = threading.RLock()  # a clone() of a user's need not know of threads


def fresh(policy: Policy) -> Policy:
    """What plays a batch in a policy's stead: a copy, or with a warning the policy itself where it has none."""
    try:
        return copied(policy)
    except PolicyError as error:
        warnings.warn(str(error), stacklevel=2)
        return policy


def can_be_copied(policy: Policy) -> bool:
    """Whether batches can be played at the same time."""
    try:
        copied(policy)
    except PolicyError:
        return False
    return True


def whole(policy: Policy, name: str, default: int) -> int:
    """An attribute of a policy that is a whole number from 1 up, or the default where it has none.

    Raises:
        PolicyError: it is something else.
    """
    value = getattr(policy, name, default)
    if not isinstance(value, int) or isinstance(value, bool) or value < 1:
        raise PolicyError(f"{type(policy).__name__}.{name} must be a whole number, 1 or more, not {quoted(value)}")
    return value


def fitting(batch: Batch, remembered: NDArray[Any]) -> NDArray[Any]:
    """An array that a policy made in ``reset``, sure to have a row for every episode: compiled code does not look.

    Raises:
        PolicyError: it was made for a batch of another size.
    """
    if len(remembered) != batch.size:
        raise PolicyError(
            f"act() was given {batch.size} episodes after a reset() for {len(remembered)}: call reset(batch) first, "
            "and give every thread a copy of the policy (copy.deepcopy)"
        )
    return remembered


def checked(actions: Any, batch: Batch) -> NDArray[np.int32]:
    """The policy's actions as the engine takes them.

    Raises:
        PolicyError: they are no actions.
    """
    try:
        array = np.array(actions)  # a copy: who holds the policy's own may change it after it has been checked
    except ValueError:  # lists of different lengths
        raise PolicyError(f"act() must return {batch.size} action indices, not {quoted(actions)}") from None
    if array.shape != (batch.size,) or array.dtype.kind not in "iu":
        raise PolicyError(
            f"act() must return {batch.size} action indices (whole numbers, one an episode), "
            f"not an array of shape {array.shape} and type {array.dtype}"
        )
    n = batch.domain.n_actions
    if array.min() < STOP or array.max() >= n:
        wrong = array[(array < STOP) | (array >= n)][0]
        raise PolicyError(
            f"act() returned action {wrong}; {batch.domain.name} has the actions 0 to {n - 1} (and {STOP}: stop here)"
        )
    return array.astype(np.int32, copy=False)


def to_words(array: NDArray[Any]) -> NDArray[np.int64]:
    """A memory as words of 64 bits, (E, …) to (E, words): whole numbers as they are, of others the bits."""
    flat = array.reshape(len(array), -1)
    return flat.astype(np.float64).view(np.int64) if array.dtype.kind == "f" else flat.astype(np.int64)


def from_words(words: NDArray[np.int64], like: NDArray[Any]) -> NDArray[Any]:
    """Inverse of :func:`to_words`."""
    words = np.ascontiguousarray(words)
    flat = words.view(np.float64) if like.dtype.kind == "f" else words
    return flat.astype(like.dtype).reshape(len(words), *like.shape[1:])


def memory_words(memory: Iterable[tuple[Any, str]]) -> NDArray[np.int64]:
    """(E, words) what ``(policy, attribute)`` after the other remember, side by side."""
    return np.hstack([to_words(getattr(policy, name)) for policy, name in memory])


def recall(memory: Iterable[tuple[Any, str, NDArray[Any]]], words: NDArray[np.int64]) -> int:
    """Inverse of :func:`memory_words`, for ``(policy, attribute, an array like it)``; how many columns it took."""
    column = 0
    for policy, name, like in memory:
        width = like[0].size
        setattr(policy, name, from_words(words[:, column : column + width], like))
        column += width
    return column


def constant(size: int, action: int) -> NDArray[np.int32]:
    """The same action for all episodes."""
    return np.full(size, action, dtype=np.int32)
