"""A domain as one Gymnasium environment."""

from __future__ import annotations

from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from harness.engine.lanes import Lanes
from harness.errors import HarnessError, quoted
from harness.gym.episodes import action_mask, first_number, loaded, observation_space, unscored_seed
from harness.gym.rendering import MODES, check_mode, frame
from harness.model.domain import Domain
from harness.play.evaluation import HORIZON
from harness.policy.encoding import Encoding

_ALL, _NONE = np.ones(1, dtype=np.bool_), np.zeros(1, dtype=np.bool_)


class PomdpEnv(gymnasium.Env[NDArray[np.float32], np.int64]):
    """One episode after the other of a domain.

    ``reset(seed=s)`` begins episode 0 of seed s, every ``reset()`` after it the next one: the episodes that
    ``harness.evaluate`` plays under that seed. ``options={"first": k}`` begins with episode k. Whoever gives no seed
    gets one that no evaluation uses. Rewards are those of the domain's shaping.

    Observations: see :class:`harness.policy.encoding.Encoding`. ``info`` holds ``action_mask`` (A,) int8 and
    ``episode_number``.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": list(MODES), "render_fps": 4}  # type: ignore[misc]

    def __init__(
        self,
        domain: Domain | str,
        *,
        observation: str = "belief",
        horizon: int = HORIZON,
        render_mode: str | None = None,
    ) -> None:
        """An environment.

        Args:
            domain: a domain or its name.
            observation: ``belief``, ``marginals``, ``reading`` or ``action-reading``.
            horizon: steps after which an episode is truncated.
            render_mode: ``ansi`` (a text), ``rgb_array`` (a picture) or None.

        Raises:
            HarnessError: an argument is wrong, or the domain has no layout to draw.
        """
        self.domain = loaded(domain, horizon)
        check_mode(render_mode, self.domain)
        self.render_mode = render_mode
        self.encoding = Encoding(observation, self.domain)
        self.observation_space = observation_space(self.encoding)  # type: ignore[assignment]
        self.action_space = spaces.Discrete(self.domain.n_actions)
        self._lanes = Lanes(self.domain, 1, horizon)
        self._begun = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin an episode.

        Raises:
            HarnessError: the seed is 2⁶⁴ or more, or ``options["first"]`` no episode's number.
        """
        super().reset(seed=seed)
        lanes = self._lanes
        if seed is None and not self._begun:
            seed = unscored_seed(self.np_random)
        first = first_number(options, seed)
        if seed is not None:
            lanes.seed[0] = seed
        lanes.start(_ALL, lanes.number + 1 if first is None else np.array([first]))
        self._begun = True
        return self._shown(), self._info()

    def step(self, action: Any) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Take one action.

        Raises:
            HarnessError: it is no action, or no episode has begun.
        """
        if not self._begun:
            raise HarnessError("no episode has begun: call reset() first")
        if not self.action_space.contains(action):
            raise HarnessError(f"the actions are 0 to {self.domain.n_actions - 1}, not {quoted(action)}")
        lanes = self._lanes
        reward = float(lanes.step(np.array([action], dtype=np.int32), _NONE)[0])
        return self._shown(), reward, bool(lanes.terminated[0]), bool(lanes.truncated[0]), self._info()

    def render(self) -> Any:
        """A text or a picture, by the render mode; None without one."""
        return None if self.render_mode is None else frame(self.render_mode, self._lanes, 0)

    def action_masks(self) -> NDArray[np.bool_]:
        """(A,) the mask under the name that ``sb3_contrib.MaskablePPO`` asks for."""
        return action_mask(self._lanes.batch)[0].view(np.bool_)

    def _shown(self) -> NDArray[np.float32]:
        return self.encoding(self._lanes.batch, self._lanes.last)[0]

    def _info(self) -> dict[str, Any]:
        return {"action_mask": action_mask(self._lanes.batch)[0], "episode_number": int(self._lanes.number[0])}
