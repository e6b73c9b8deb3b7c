"""How much a suite plays, and which policies on which domain."""

from __future__ import annotations

from dataclasses import dataclass

from harness import policy as specs
from harness.errors import HarnessError, nearest, quoted
from harness.model.domain import Domain
from harness.play.evaluation import EPISODES
from harness.policy import Policy
from harness.policy.base import whole
from harness.score import bounds


@dataclass(frozen=True)
class Budget:
    """What is played of every policy on every domain."""

    name: str
    episodes: int
    planned: int
    """Of policies that plan by simulation, at most: those that have ``max_episodes``."""
    planners: tuple[str, ...]
    """Policy strings of the online planners: they are played on every domain, by this budget an action."""

    def policies(self, domain: Domain) -> list[str]:
        """Policy strings: those of the domain's baseline table, the planners, and the bound that it ends with."""
        planners = [each for each in self.planners if _word(each) != "despot" or domain.n_states <= specs.LARGE]
        words = {_word(each) for each in self.planners}
        own = [each for each in specs.default_specs(domain) if _word(each) not in words]
        return [*own, *planners, *bounds.default(domain)]

    def episodes_of(self, policy: Policy) -> int:
        """How many episodes a policy plays."""
        most = whole(policy, "max_episodes", EPISODES)
        return min(self.episodes, most if most >= EPISODES else min(most, self.planned))


def _word(spec: str) -> str:
    return spec.partition(":")[0]


QUICK = Budget("quick", 1_000, 20, ("rollout:100", "pomcp:100", "despot:50"))
"""A few minutes on two cores; errors are wide, those of the planners above all."""
FULL = Budget("full", EPISODES, 1_000, ("rollout:100", "pomcp:1000", "despot:100"))
"""What ``compare`` plays: 10,000 episodes, 1,000 of ``rollout`` and 100 of the other planners; an hour or two."""

BUDGETS = {budget.name: budget for budget in (QUICK, FULL)}


def named(budget: str | Budget) -> Budget:
    """A budget, or the one of a name.

    Raises:
        HarnessError: there is none of that name.
    """
    if isinstance(budget, Budget):
        return budget
    if budget not in BUDGETS:
        raise HarnessError(f"no budget {quoted(budget)}{nearest(budget, BUDGETS)} (known: {', '.join(BUDGETS)})")
    return BUDGETS[budget]
