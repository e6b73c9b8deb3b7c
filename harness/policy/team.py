"""Decentralised play: a policy for each agent, which sees its own readings and nothing else."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.engine.batch import Batch, read_only
from harness.errors import PolicyError
from harness.model.agents import action_strides, local_view, own_observations
from harness.model.domain import Domain
from harness.model.tables import STOP
from harness.policy.base import Policy, checked, copied, memory_words, recall
from harness.policy.fsc import FileController, of_record
from harness.policy.program import ProgramPolicy, require_model
from harness.program import Program


class _Local(Batch):
    """A batch as one agent sees it. It holds no way back to the batch of all: not even the seed."""

    def __init__(self, batch: Batch, agent: int, observation: NDArray[np.int32]) -> None:
        count = len(batch.domain.agents)
        self.domain, self.step = local_view(batch.domain, agent), batch.step
        self.visible, self.observation = read_only(batch.done.astype(np.int32)), read_only(observation)
        self.marginals, self.done = read_only(np.zeros((batch.size, 0))), batch.done
        self._draw = lambda stream: batch.uniform(stream * count + agent)

    def uniform(self, stream: int = 0) -> NDArray[np.float64]:
        """(E,) random numbers of this agent's own, as :meth:`harness.engine.batch.Batch.uniform`."""
        return self._draw(stream)


def local_batches(batch: Batch) -> list[Batch]:
    """A batch of a domain with agents as each of them sees it."""
    own = own_observations(batch.domain, batch.observation)
    return [_Local(batch, i, own[i]) for i in range(len(own))]


class TeamPolicy:
    """Plays a domain with agents (a Dec-POMDP) by one policy an agent.

    Each is given batches of its own: their ``domain`` is the agent's :func:`harness.local_view`, their observations are
    the agent's readings, their visible part says whether the episode has ended, and there is no belief, for that would
    be of all readings. Random numbers differ from agent to agent. As soon as one stops (by −1), all do.
    """

    uses_belief = False

    def __init__(self, domain: Domain, members: Sequence[Policy], *, name: str = "team") -> None:
        """A team.

        Args:
            domain: with agents.
            members: a policy for each of its agents, in their order; all different objects.
            name: what tables call it.

        Raises:
            PolicyError: the domain has no agents, or another number of them.
        """
        if len(members) != len(domain.agents):
            raise PolicyError(_needed(domain))
        self.name, self._members = name, tuple(members)
        for limit in ("batch_size", "max_episodes"):
            if found := [getattr(member, limit) for member in members if hasattr(member, limit)]:
                setattr(self, limit, min(found))
        kept = [getattr(member, "memory", None) for member in members]
        if None not in kept:
            self.memory = ("remembered",) if any(kept) else ()

    def clone(self) -> TeamPolicy:
        """A team of copies."""
        made = object.__new__(type(self))
        made.__dict__ |= self.__dict__ | {"_members": tuple(copied(member) for member in self._members)}
        return made

    def reset(self, batch: Batch) -> None:
        """Begin new episodes.

        Raises:
            PolicyError: the domain has other agents.
        """
        if len(batch.domain.agents) != len(self._members):
            raise PolicyError(_needed(batch.domain))
        for member, local in zip(self._members, local_batches(batch), strict=True):
            member.reset(local)

    def act(self, batch: Batch) -> NDArray[np.int32]:
        """The joint action of what each does by itself.

        Raises:
            PolicyError: what a member returns is none of its actions.
        """
        locals_ = local_batches(batch)
        own = [checked(member.act(local), local) for member, local in zip(self._members, locals_, strict=True)]
        joint = action_strides(batch.domain) @ np.array(own, dtype=np.int64)
        return np.where((np.array(own) == STOP).any(axis=0), STOP, joint).astype(np.int32)

    @property
    def remembered(self) -> NDArray[np.int64]:
        """(E, …) the memory of all members, side by side, in words of 64 bits."""
        return memory_words(self._memories())

    @remembered.setter
    def remembered(self, words: NDArray[np.int64]) -> None:
        recall([(member, name, getattr(member, name)) for member, name in self._memories()], words)

    def _memories(self) -> list[tuple[Any, str]]:
        return [(member, name) for member in self._members for name in getattr(member, "memory", ())]


class ProgramTeam(TeamPolicy):
    """Runs a program with a section for each agent."""

    def __init__(self, program: Program) -> None:
        """``program``: compiled for the domain that it will run on."""
        super().__init__(program.words.domain, [ProgramPolicy(part) for part in program.parts], name=ProgramPolicy.name)
        self.program = program

    @property
    def at(self) -> NDArray[np.int64]:
        """(E, n) instruction of the program that each agent's last operation is; −1 for one that has ended."""
        lengths = np.array([len(part.code) for part in self.program.parts])
        own = np.stack([each.at for each in self._members if isinstance(each, ProgramPolicy)], axis=1)
        return np.where(own < 0, -1, own + np.cumsum(lengths) - lengths)


def policy_of(program: Program) -> ProgramPolicy | ProgramTeam:
    """What plays a program: a controller, or where it has a section for each agent a team."""
    return ProgramTeam(program) if program.parts else ProgramPolicy(program)


def stored_team(path: Path, domain: Domain) -> TeamPolicy:
    """The team of a file with the controllers of all its members (:mod:`harness.policy.fsc`).

    Raises:
        PolicyError: the file is damaged, or the team was made for another model.
    """
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
        controllers, _ = list(record["members"]), record["model_hash"]
    except (OSError, ValueError, KeyError, TypeError):
        raise PolicyError(f"{path}: not a readable team; make it again (benchmarks/teams.py)") from None
    require_model(record, path, domain, "made", "make it again (benchmarks/teams.py)")
    views = [local_view(domain, i) for i in range(len(domain.agents))]
    try:
        members = [FileController(view, of_record(each, view)) for view, each in zip(views, controllers, strict=False)]
        return TeamPolicy(domain, members)
    except PolicyError as error:
        raise PolicyError(f"{path}: {error}") from None


def _needed(domain: Domain) -> str:
    if not domain.agents:
        return f"{domain.name} has no agents: one controller acts there, not a team"
    agents = ", ".join(agent.name for agent in domain.agents)
    return f"{domain.name} needs {len(domain.agents)} policies, one for each of {agents}"
