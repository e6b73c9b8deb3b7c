"""Agents that learned elsewhere as policies; no framework is imported, only the methods of what is given are called."""

from __future__ import annotations

import copy
import threading
from collections.abc import Callable
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from harness.engine.batch import Batch
from harness.errors import PolicyError
from harness.policy.base import fitting
from harness.policy.encoding import Encoding, check_kind, shows_belief

_PREDICTING = threading.Lock()  # an agent keeps its last distribution in itself, as Stable-Baselines3's do
_Own = TypeVar("_Own", bound="_Watching")


class Agent(Protocol):
    """What Stable-Baselines3's algorithms and policies have."""

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = False
    ) -> Any:
        """Actions (E,) and the next state, for observations (E, D); ``episode_start`` (E,) says where one begins."""


class _Watching:
    """What both adapters share: the vectors of :class:`harness.policy.encoding.Encoding`, and the last actions."""

    def __init__(self, observation: str, legal: bool, deterministic: bool, name: str) -> None:
        check_kind(observation)
        self.observation, self.legal, self.deterministic, self.name = observation, legal, deterministic, name
        self.uses_belief = legal or shows_belief(observation)

    def reset(self, batch: Batch) -> None:
        """Begin new episodes: no action before the first, no state.

        Raises:
            PolicyError: the agent was trained on vectors of another length.
        """
        self._encoding = Encoding(self.observation, batch.domain)
        self._last = np.full(batch.size, -1, dtype=np.int32)
        self._state: Any = None

    def clone(self: _Own) -> _Own:
        """A policy with the same agent, which is not written to, and with a memory of its own once it is reset."""
        return copy.copy(self)

    def _seen(self, batch: Batch) -> NDArray[np.float32]:
        return self._encoding(batch, fitting(batch, self._last))

    def _took(self, actions: Any) -> NDArray[np.int32]:
        self._last = np.asarray(actions).astype(np.int32)
        return self._last

    def _mask(self, batch: Batch) -> NDArray[np.bool_]:
        """(E, A) legal actions; of ended episodes all."""
        return batch.legal() | batch.done[:, None]


class AgentPolicy(_Watching):
    """An agent with ``predict(observation, state, episode_start, deterministic)``, recurrent or not.

    That is a model or a policy of Stable-Baselines3 and sb3-contrib, or anything with that method. An agent that draws
    its actions (``deterministic=False``) does so from a generator of its own: its scores vary from run to run.
    """

    def __init__(
        self,
        agent: Agent,
        *,
        observation: str = "belief",
        legal: bool = False,
        deterministic: bool = True,
        name: str = "agent",
    ) -> None:
        """A policy.

        Args:
            agent: it is shared by all copies of the policy.
            observation: what it was trained on: ``belief``, ``marginals``, ``reading`` or ``action-reading``.
            legal: give it the legal actions too, as ``action_masks`` (``sb3_contrib.MaskablePPO``).
            deterministic: take its best actions.
            name: what tables call it.

        Raises:
            HarnessError: there is no such observation.
        """
        super().__init__(observation, legal, deterministic, name)
        self.agent = agent

    def reset(self, batch: Batch) -> None:
        """Begin new episodes."""
        super().reset(batch)
        self._begins = np.ones(batch.size, dtype=np.bool_)
        shape = getattr(getattr(self.agent, "observation_space", None), "shape", None)
        if shape not in (None, (self._encoding.size,)):
            raise PolicyError(
                f"the agent {self.name} was trained on observations of shape {shape}; {self.observation!r} of "
                f"{batch.domain.name} has shape {(self._encoding.size,)}: say which observation it was trained on"
            )

    def act(self, batch: Batch) -> NDArray[np.int32]:
        """The agent's actions."""
        masks = {"action_masks": self._mask(batch)} if self.legal else {}
        with _PREDICTING:
            actions, self._state = self.agent.predict(
                self._seen(batch),
                state=self._state,
                episode_start=self._begins,
                deterministic=self.deterministic,
                **masks,
            )
        self._begins = np.zeros(batch.size, dtype=np.bool_)
        return self._took(actions)


class LogitsPolicy(_Watching):
    """A network that gives a logit an action: a ``torch.nn.Module``, or any function of an array (E, D).

    It is called with the observations and returns (E, A) logits; a recurrent one returns a pair of them and its state,
    and is called with that state as its second argument from the second step on. Of a module a frozen copy plays
    (``eval()``, no gradients), on the device and in the number type of its parameters.
    """

    def __init__(
        self,
        network: Callable[..., Any],
        *,
        observation: str = "belief",
        legal: bool = False,
        deterministic: bool = True,
        name: str = "network",
    ) -> None:
        """A policy.

        Args:
            network: the module or function; it is shared by all copies of the policy.
            observation: what it was trained on: ``belief``, ``marginals``, ``reading`` or ``action-reading``.
            legal: leave out the actions that the belief knows to be illegal.
            deterministic: take the action of the greatest logit; else draw from their softmax, with the harness's
                random numbers, so that scores are the same every time.
            name: what tables call it.

        Raises:
            HarnessError: there is no such observation.
        """
        super().__init__(observation, legal, deterministic, name)
        self.network, self._as_input = _frozen(network)

    def act(self, batch: Batch) -> NDArray[np.int32]:
        """The actions that its logits ask for."""
        logits = self._logits(self._as_input(self._seen(batch)))
        if logits.shape != (batch.size, batch.domain.n_actions):
            wanted = (batch.size, batch.domain.n_actions)
            raise PolicyError(f"the network {self.name} must give logits of shape {wanted}, not {logits.shape}")
        if self.legal:
            logits = np.where(self._mask(batch), logits, -np.inf)
        return self._took(logits.argmax(axis=1) if self.deterministic else drawn(logits, batch.uniform()))

    def _logits(self, seen: Any) -> NDArray[np.float64]:
        found = self.network(seen) if self._state is None else self.network(seen, self._state)
        logits, self._state = found if isinstance(found, tuple) else (found, None)
        return np.asarray(logits.cpu() if hasattr(logits, "cpu") else logits, dtype=np.float64)


def _frozen(network: Any) -> tuple[Any, Callable[[Any], Any]]:
    """What is called, and what makes its input of an array."""
    first = next(iter(network.parameters()), None) if hasattr(network, "parameters") else None
    if first is None:
        return network, lambda array: array
    return copy.deepcopy(network).eval().requires_grad_(False), first.detach().new_tensor


def drawn(logits: NDArray[np.float64], u: NDArray[np.float64]) -> NDArray[np.intp]:
    """(E,) an action a row from the softmax of ``logits`` (E, A), by inverse CDF at ``u`` (E,) in [0, 1)."""
    cdf = np.exp(logits - logits.max(axis=1, keepdims=True)).cumsum(axis=1)
    total = cdf[:, -1]
    below = np.minimum(u * total, np.nextafter(total, 0))  # so that rounding picks nothing of probability 0
    return (cdf > below[:, None]).argmax(axis=1)
