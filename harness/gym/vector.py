"""A domain as a Gymnasium vector environment: one batch of the engine, not a loop over single environments."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, ClassVar, NamedTuple

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from harness import host
from harness.engine.lanes import Lanes
from harness.errors import HarnessError, quoted
from harness.gym.episodes import action_mask, check_lanes, first_number, loaded, observation_space, unscored_seed
from harness.gym.rendering import MODES, check_mode, frame
from harness.model.domain import Domain
from harness.play.evaluation import HORIZON
from harness.policy.encoding import Encoding

_LEAST = 2_000  # lanes a thread: with fewer, waking it costs more than it saves
Flags = NDArray[np.bool_]


class _Part(NamedTuple):
    """The lanes of one thread, and their place among all."""

    at: slice
    lanes: Lanes


class _Shown(NamedTuple):
    """What a call returns of all lanes; every array is new and has a row a lane."""

    observation: NDArray[np.float32]
    mask: NDArray[np.int8]
    reward: NDArray[np.float64]
    terminated: Flags
    truncated: Flags
    number: NDArray[np.int64]


class PomdpVectorEnv(VectorEnv[NDArray[np.float32], NDArray[np.int64], NDArray[Any]]):
    """E lanes, each playing one episode after the other of a domain.

    ``reset(seed=s)`` begins in lane i with episode i of seed s; when it ends the lane goes on with episode i + E, then
    i + 2E, and so on: together the lanes play the episodes that ``harness.evaluate`` plays under that seed, each once,
    whoever ends first. ``options={"first": k}`` begins with episode k + i instead.
    ``options={"reset_mask": (E,) bool}`` resets some lanes only: to their next episodes, or with a seed to its
    episodes. Whoever gives no seed gets one that no evaluation uses.

    Autoreset is by Gymnasium's modes: ``NEXT_STEP`` (the action after an end is ignored and pays 0), ``SAME_STEP``
    (what was last seen is in ``info["final_obs"]`` and ``info["final_info"]``) and ``DISABLED``.

    ``info`` holds ``action_mask`` (E, A) int8 and ``episode_number`` (E,). Observations: see
    :class:`harness.policy.encoding.Encoding`.
    """

    metadata: ClassVar[dict[str, Any]] = {  # type: ignore[misc]
        "render_modes": list(MODES),
        "render_fps": 4,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }
    _pool: ThreadPoolExecutor | None = None  # Gymnasium closes what could not be made, too

    def __init__(
        self,
        domain: Domain | str,
        num_envs: int = 1,
        *,
        observation: str = "belief",
        horizon: int = HORIZON,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
        workers: int | None = None,
    ) -> None:
        """A vector environment.

        Args:
            domain: a domain or its name.
            num_envs: number E of lanes.
            observation: ``belief``, ``marginals``, ``reading`` or ``action-reading``.
            horizon: steps after which an episode is truncated.
            autoreset_mode: Gymnasium's, or its value (``NextStep``, ``SameStep``, ``Disabled``).
            render_mode: ``ansi`` (a text a lane), ``rgb_array`` (a picture a lane) or None.
            workers: threads (default: one a core); nothing depends on it but the speed.

        Raises:
            HarnessError: an argument is wrong, or the domain has no layout to draw.
        """
        self.domain = loaded(domain, horizon)
        check_lanes(num_envs)
        check_mode(render_mode, self.domain)
        self.num_envs, self.render_mode = num_envs, render_mode
        self._mode = _autoreset(autoreset_mode)
        self.metadata = {**self.metadata, "autoreset_mode": self._mode}  # type: ignore[misc]
        self.encoding = Encoding(observation, self.domain)
        self.single_observation_space = observation_space(self.encoding)
        self.single_action_space = spaces.Discrete(self.domain.n_actions)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._parts = _parts(self.domain, num_envs, horizon, host.workers(workers))
        if len(self._parts) > 1:
            self._pool = ThreadPoolExecutor(len(self._parts))
        self._all = np.ones(num_envs, dtype=np.bool_)
        self._ended = np.zeros(num_envs, dtype=np.bool_)
        self._begun = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin episodes in all lanes, or in those of ``options["reset_mask"]``.

        Raises:
            HarnessError: the seed is 2⁶⁴ or more, or an option is wrong.
        """
        super().reset(seed=seed)
        which = self._chosen((options or {}).get("reset_mask"))
        if seed is None and not self._begun:
            seed = unscored_seed(self.np_random)
        first = first_number(options, seed)
        shown = self._new()

        def begin(part: _Part) -> None:
            at, lanes = part
            if seed is not None:
                lanes.seed[which[at]] = seed
            own = np.arange(at.start, at.stop)
            lanes.start(which[at], lanes.number + self.num_envs if first is None else first + own)
            self._show(part, shown)

        self._each(begin)
        self._ended[which] = False
        self._begun = True
        return shown.observation, _info(shown.mask, shown.number, self._all)

    def step(self, actions: Any) -> tuple[NDArray[np.float32], NDArray[np.float64], Flags, Flags, dict[str, Any]]:
        """One action a lane, (E,) whole numbers.

        Raises:
            HarnessError: they are no actions, no episode has begun, or a lane that has ended was not reset and the
                mode is ``DISABLED``.
        """
        taken = self._checked(actions)
        shown = self._new()
        self._each(lambda part: self._play(part, taken[part.at], shown))
        ended = shown.terminated | shown.truncated
        info = _info(shown.mask, shown.number, self._all)
        if self._mode is not AutoresetMode.SAME_STEP:
            self._ended = ended
        elif ended.any():
            info |= _final_info(shown, ended)
            self._restart(ended, shown)
        return shown.observation, shown.reward, shown.terminated, shown.truncated, info

    def render(self) -> tuple[Any, ...] | None:
        """A text or a picture a lane, by the render mode; None without one."""
        if self.render_mode is None:
            return None
        return tuple(frame(self.render_mode, part.lanes, e) for part in self._parts for e in range(part.lanes.size))

    def close_extras(self, **_: Any) -> None:
        """Let the threads go."""
        if self._pool is not None:
            self._pool.shutdown()

    def _play(self, part: _Part, taken: NDArray[np.int32], shown: _Shown) -> None:
        """One step of a part; under ``NEXT_STEP`` the lanes that have ended begin anew instead."""
        at, lanes = part
        idle = self._ended[at]
        shown.reward[at] = lanes.step(taken, idle)
        if idle.any():
            lanes.start(idle, lanes.number + self.num_envs)
        shown.terminated[at], shown.truncated[at] = lanes.terminated, lanes.truncated
        self._show(part, shown)

    def _show(self, part: _Part, shown: _Shown) -> None:
        at, lanes = part
        shown.observation[at] = self.encoding(lanes.batch, lanes.last)
        shown.mask[at] = action_mask(lanes.batch)
        shown.number[at] = lanes.number

    def _restart(self, which: Flags, shown: _Shown) -> None:
        """Begin the next episodes of some lanes, and show these again."""
        for at, lanes in self._parts:
            mine = which[at]
            lanes.start(mine, lanes.number + self.num_envs)
            batch = lanes.some(mine)
            shown.observation[at][mine] = self.encoding(batch, lanes.last[mine])
            shown.mask[at][mine] = action_mask(batch)
            shown.number[at][mine] = lanes.number[mine]

    def _new(self) -> _Shown:
        n = self.num_envs
        return _Shown(
            np.empty((n, self.encoding.size), dtype=np.float32),
            np.empty((n, self.domain.n_actions), dtype=np.int8),
            np.empty(n),
            np.empty(n, dtype=np.bool_),
            np.empty(n, dtype=np.bool_),
            np.empty(n, dtype=np.int64),
        )

    def _each(self, job: Callable[[_Part], None]) -> None:
        """The job done for every part, by the threads; what fails in one is raised here."""
        for _ in (map if self._pool is None else self._pool.map)(job, self._parts):
            pass

    def _checked(self, actions: Any) -> NDArray[np.int32]:
        if not self._begun:
            raise HarnessError("no episode has begun: call reset() first")
        if self._mode is AutoresetMode.DISABLED and self._ended.any():
            raise HarnessError("an episode has ended: reset its lane first, by options={'reset_mask': ...}")
        array = np.asarray(actions)
        if array.shape != (self.num_envs,) or array.dtype.kind not in "iu":
            raise HarnessError(f"step() takes {self.num_envs} action indices, not {quoted(actions)}")
        if array.min() < 0 or array.max() >= self.domain.n_actions:
            raise HarnessError(f"the actions are 0 to {self.domain.n_actions - 1}, not {array.min()} to {array.max()}")
        return array.astype(np.int32, copy=False)

    def _chosen(self, mask: Any) -> Flags:
        """(E,) which lanes are to be reset."""
        if mask is None:
            return self._all
        array = np.asarray(mask)
        if array.shape != (self.num_envs,) or array.dtype != np.bool_:
            raise HarnessError(f"options['reset_mask'] must be {self.num_envs} booleans, not {quoted(mask)}")
        if not (self._begun or array.all()):
            raise HarnessError("no episode has begun: reset all lanes first")
        return array


def _info(mask: NDArray[np.int8], number: NDArray[np.int64], which: Flags) -> dict[str, Any]:
    """As Gymnasium has it: beside every array (a row a lane), which lanes it holds of."""
    return {
        "action_mask": mask,
        "_action_mask": which.copy(),
        "episode_number": number,
        "_episode_number": which.copy(),
    }


def _final_info(shown: _Shown, ended: Flags) -> dict[str, Any]:
    """What is shown now of the lanes that have ended, as Gymnasium's own vector environments give it."""
    observations = np.full(len(ended), None, dtype=object)
    for e, row in zip(np.flatnonzero(ended), shown.observation[ended], strict=True):
        observations[e] = row
    mask, number = shown.mask * ended[:, None], shown.number * ended
    return {
        "final_obs": observations,
        "_final_obs": ended,
        "final_info": _info(mask, number, ended),
        "_final_info": ended.copy(),
    }


def _autoreset(mode: AutoresetMode | str) -> AutoresetMode:
    try:
        return AutoresetMode(mode)
    except ValueError:
        known = ", ".join(each.value for each in AutoresetMode)
        raise HarnessError(f"no autoreset mode {quoted(mode)} (known: {known})") from None


def _parts(domain: Domain, lanes: int, horizon: int, workers: int) -> list[_Part]:
    """The lanes in as many parts of about one size as threads are worth it."""
    count = max(1, min(workers, lanes // _LEAST))
    edges = [lanes * i // count for i in range(count + 1)]
    return [_Part(slice(a, b), Lanes(domain, b - a, horizon)) for a, b in itertools.pairwise(edges)]
