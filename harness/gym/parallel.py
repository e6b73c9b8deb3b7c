"""A domain with agents as a PettingZoo environment in which all of them act at once.

Needs PettingZoo: ``pip install 'pomdp-harness[pettingzoo]'``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from harness.engine.lanes import Lanes
from harness.errors import HarnessError, quoted
from harness.gym.episodes import first_number, loaded, observation_space, unscored_seed
from harness.gym.rendering import MODES, check_mode, frame
from harness.model.agents import action_strides, local_view
from harness.model.domain import Domain
from harness.play.evaluation import HORIZON
from harness.policy.encoding import Encoding, shows_belief
from harness.policy.team import local_batches

try:
    from pettingzoo import ParallelEnv
except ImportError as error:
    raise ImportError("harness.gym.parallel needs PettingZoo: pip install 'pomdp-harness[pettingzoo]'") from error

_ALL, _NONE = np.ones(1, dtype=np.bool_), np.zeros(1, dtype=np.bool_)


class TeamEnv(ParallelEnv[str, NDArray[np.float32], np.int64]):
    """One episode after the other of a domain with agents, each of which sees its own readings.

    Every agent is paid the reward of the team, which is what all of them are to make as high as they can. Episodes,
    seeds and horizon are those of :class:`harness.gym.single.PomdpEnv`; so are the returns those of
    ``harness.evaluate(domain, TeamPolicy(…), seed=s)``. ``info`` holds ``episode_number``.
    """

    metadata: ClassVar[dict[str, Any]] = {"name": "pomdp_harness", "render_modes": list(MODES), "render_fps": 4}

    def __init__(
        self,
        domain: Domain | str,
        *,
        observation: str = "action-reading",
        horizon: int = HORIZON,
        render_mode: str | None = None,
    ) -> None:
        """An environment.

        Args:
            domain: a domain with agents, or its name.
            observation: ``action-reading`` or ``reading``, of the agent's own
                (:class:`harness.policy.encoding.Encoding` over its :func:`harness.local_view`).
            horizon: steps after which an episode is truncated.
            render_mode: ``ansi`` (a text), ``rgb_array`` (a picture) or None.

        Raises:
            HarnessError: an argument is wrong, or the domain has no agents.
        """
        self.domain = loaded(domain, horizon)
        if not self.domain.agents:
            raise HarnessError(f"{self.domain.name} has no agents: take harness.gym.PomdpEnv")
        check_mode(render_mode, self.domain)
        self.render_mode = render_mode
        self.possible_agents = [agent.name for agent in self.domain.agents]
        self.agents: list[str] = []
        views = [local_view(self.domain, i) for i in range(len(self.possible_agents))]
        self._encodings = [Encoding(observation, view) for view in views]
        if shows_belief(observation):
            raise HarnessError(f"an agent has no belief of its own: observation 'reading', not {quoted(observation)}")
        self.observation_spaces = self._by_name([observation_space(encoding) for encoding in self._encodings])
        self.action_spaces = self._by_name([spaces.Discrete(view.n_actions) for view in views])
        self._joint = Encoding("belief", self.domain)
        self.state_space = observation_space(self._joint)
        self._strides = action_strides(self.domain)
        self._lanes = Lanes(self.domain, 1, horizon)
        self._begun = False

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """What an agent's observations lie in."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """An agent's actions."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[dict[str, NDArray[np.float32]], dict[str, dict[str, Any]]]:
        """Begin an episode.

        Raises:
            HarnessError: the seed is 2⁶⁴ or more, or ``options["first"]`` no episode's number.
        """
        lanes = self._lanes
        if seed is None and not self._begun:
            seed = unscored_seed(np.random.default_rng())
        first = first_number(options, seed)
        if seed is not None:
            lanes.seed[0] = seed
        lanes.start(_ALL, lanes.number + 1 if first is None else np.array([first]))
        self._begun, self.agents = True, list(self.possible_agents)
        return self._shown(), self._infos()

    def step(self, actions: Mapping[str, Any]) -> tuple[
        dict[str, NDArray[np.float32]], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]
    ]:  # fmt: skip
        """One action of every agent.

        Raises:
            HarnessError: it is no action, an agent's is missing, or no episode is under way.
        """
        if not self.agents:
            raise HarnessError("no episode is under way: call reset() first")
        for name, space in self.action_spaces.items():
            if name not in actions or not space.contains(actions[name]):
                raise HarnessError(f"{name} has the actions 0 to {space.n - 1}, not {quoted(actions.get(name))}")
        joint = sum(int(actions[name]) * int(n) for name, n in zip(self.possible_agents, self._strides, strict=True))
        lanes = self._lanes
        reward = float(lanes.step(np.array([joint], dtype=np.int32), _NONE)[0])
        terminated, truncated = bool(lanes.terminated[0]), bool(lanes.truncated[0])
        if terminated or truncated:
            self.agents = []
        n = len(self.possible_agents)
        ends = self._by_name([terminated] * n), self._by_name([truncated] * n)
        return self._shown(), self._by_name([reward] * n), *ends, self._infos()

    def state(self) -> NDArray[np.float32]:
        """What one controller of all would see, which learning may use and acting may not: visible part and belief."""
        return self._joint(self._lanes.batch, self._lanes.last)[0]

    def render(self) -> Any:
        """A text or a picture, by the render mode; None without one."""
        return None if self.render_mode is None else frame(self.render_mode, self._lanes, 0)

    def _shown(self) -> dict[str, NDArray[np.float32]]:
        lanes, sizes = self._lanes, [encoding.domain.n_actions for encoding in self._encodings]
        did = np.where(lanes.last < 0, -1, lanes.last // self._strides % sizes).astype(np.int32)
        seen = zip(self._encodings, local_batches(lanes.batch), did, strict=True)
        return self._by_name([encoding(batch, own[None])[0] for encoding, batch, own in seen])

    def _infos(self) -> dict[str, dict[str, Any]]:
        return self._by_name([{"episode_number": int(self._lanes.number[0])} for _ in self.possible_agents])

    def _by_name(self, values: list[Any]) -> dict[str, Any]:
        return dict(zip(self.possible_agents, values, strict=True))
