"""POMCP: Monte-Carlo tree search over histories (Silver and Veness 2010), compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.engine.batch import Batch
from harness.errors import PolicyError
from harness.model.domain import Domain
from harness.model.splitmix import next_uniform
from harness.model.tables import Records, compiled, draw_labels, draw_outcome, draw_reading, inlined, row_of
from harness.policy.base import fitting
from harness.policy.planner.budget import MOST, Budget, number, parse, whole
from harness.policy.planner.preferred import Preferences, names_preferred, note, preferences_of, preferred
from harness.policy.planner.random_play import random_legal, random_return
from harness.policy.planner.simulating import LONGEST, Model, draw_hidden, model_of, reward_range
from harness.policy.planner.tree import EDGE, NODE, add_node, advance, child_of, nodes_for, tree_bytes

WORD = "pomcp"
SIMULATIONS = 1000
_PRIOR_VISITS = 10  # of a preferred action, before there is any
_MEMORY = 2**28  # bytes of the trees of a batch
_RULES = ("preferred", "legal")


class Scratch(NamedTuple):
    """What one simulation writes to."""

    values: NDArray[np.int16]
    """(1, K) the hidden part."""
    options: NDArray[np.int32]
    """(A,) preferred actions."""
    tally: NDArray[np.int16]
    """(K,) good less bad readings of every rock."""
    readings: NDArray[np.int16]
    """(K,)"""
    taken: NDArray[np.int64]
    """(horizon,) edges of the tree."""
    paid: NDArray[np.float64]
    """(horizon,) rewards."""


class POMCPPolicy:
    """Partially observable Monte-Carlo planning: UCB1 in a tree over histories, random rollouts below it.

    Every simulation draws the hidden part from the exact belief, where the paper's particle filter has an
    approximation. It goes down the tree by the action of the largest value + exploration · √(log N / n), untried ones
    first, adds one history, and goes on by the rollout rule as far as a reward weighs a hundredth. Where a domain
    names preferred actions (RockSample), rollouts draw from these and new histories begin with ten visits of them, all
    of a value as large as the reward range; elsewhere rollouts draw from the legal actions. The action of the highest
    mean is taken, the first of equals.

    What was found below the action and reading that came true is kept for the next step. Every episode has a tree of
    its own and random numbers seeded by (seed, step, episode), so that neither batches nor threads change an action.
    """

    max_episodes = 100
    """As many episodes does a comparison give it unless told otherwise."""

    def __init__(
        self,
        domain: Domain,
        budget: Budget = Budget(SIMULATIONS),  # noqa: B008 - frozen
        exploration: float | None = None,
        rollout: str = "",
        depth: int | None = None,
    ) -> None:
        """A planner for a domain.

        Args:
            domain: what it plans for, under the true reward.
            budget: of one action.
            exploration: the constant of UCB1, in units of reward; by default :func:`.reward_range`, as in the paper.
            rollout: ``preferred`` or ``legal``; by default preferred where the domain names such actions.
            depth: steps that a simulation reaches ahead; by default as far as a reward weighs a hundredth.

        Raises:
            PolicyError: preferred actions are asked for and the domain names none.
        """
        if rollout == "preferred" and not names_preferred(domain):
            raise PolicyError(f"{domain.name} names no preferred actions; leave rollout=preferred out")
        self.budget = budget
        self._hope = reward_range(domain)
        self.exploration = self._hope if exploration is None else exploration
        self._model = model_of(domain, depth)
        self._preferences = preferences_of(domain, rollout != "legal")
        self._nodes = nodes_for(budget.count)
        self.batch_size = max(1, min(32, _MEMORY // tree_bytes(self._nodes, domain.n_actions)))

    def reset(self, batch: Batch) -> None:
        """Nothing has been thought or read yet."""
        size, rocks = batch.size, self._preferences.closer.shape[1]
        self._tree = np.empty((size, self._nodes), NODE), np.empty((size, self._nodes * self._model.n_actions), EDGE)
        self._used = np.zeros(size, dtype=np.int64)
        self._seen = np.zeros((size, 2), dtype=np.int32)  # visible value and action of the step before
        self._tally = np.zeros((size, rocks), dtype=np.int16)
        self._readings = np.zeros((size, rocks), dtype=np.int16)

    def act(self, batch: Batch) -> NDArray[np.int32]:
        """One action an episode."""
        fitting(batch, self._used)
        actions = np.zeros(batch.size, dtype=np.int32)
        states = (batch.uniform() * 2.0**53).astype(np.uint64)
        marginals = batch.tracked()
        for e in map(int, np.flatnonzero(~batch.done)):
            self._follow(e, int(batch.visible[e]), int(batch.observation[e]), batch.step)
            for portion in self.budget.portions():
                self._used[e] = _plan(
                    self._model, self._preferences, self._tree[0][e], self._tree[1][e], self._used[e],
                    marginals[e : e + 1], states[e : e + 1], self._tally[e], self._readings[e], portion,
                    self.exploration, self._hope,
                )  # fmt: skip
            actions[e] = _best(self._tree[1][e], self._model.n_actions)
            self._seen[e] = batch.visible[e], actions[e]
        return actions

    def _follow(self, e: int, v: int, o: int, step: int) -> None:
        """Keep of the episode's tree what lies below the action taken and what came of it."""
        if step > 0 and self._used[e]:
            _remember(self._preferences, self._seen[e], o, self._tally[e], self._readings[e])
        self._used[e] = advance(
            self._tree[0][e], self._tree[1][e], self._model.n_actions, self._used[e], self._seen[e, 1], v, o
        )


def make(domain: Domain, text: str) -> POMCPPolicy:
    """The planner of a policy string: ``1000``, ``time=100ms``, ``1000,exploration=10,rollout=legal``.

    Raises:
        PolicyError: something in it is unknown or out of range.
    """
    found = parse(WORD, text, "simulations", _SETTINGS)
    milliseconds = found.pop("time", None)
    count = found.pop("simulations", MOST if milliseconds else SIMULATIONS)
    return POMCPPolicy(domain, Budget(count, milliseconds), **found)


_SETTINGS = {
    "exploration": lambda text: number(text, 1e9),
    "rollout": lambda text: _rule(text),
    "depth": lambda text: whole(text, LONGEST),
}


def _rule(text: str) -> str:
    if text not in _RULES:
        raise ValueError(" or ".join(_RULES))
    return text


@compiled
def _remember(
    p: Preferences, seen: NDArray[np.int32], o: int, tally: NDArray[np.int16], readings: NDArray[np.int16]
) -> None:
    if len(p.here) > 0:
        note(p.here, p.weight, p.sample, p.check, p.good, seen[0], seen[1], o, tally, readings)


@compiled
def _best(edges: Records, n_actions: int) -> int:
    best = -1
    for a in range(n_actions):
        if edges[a].visits > 0 and (best < 0 or edges[a].value > edges[best].value):
            best = a
    return max(best, 0)


@inlined
def _select(
    edges: Records,
    first: int,
    allowed: NDArray[np.bool_],
    va: int,
    n_actions: int,
    visits: int,
    exploration: float,
    state: NDArray[np.uint64],
) -> int:
    """The action of the highest upper confidence bound; looked through from a random one on, so that ties are fair."""
    best, most, log = -1, 0.0, math.log(visits + 1.0)
    a = int(next_uniform(state) * n_actions)
    for _ in range(n_actions):
        if allowed[va + a]:
            n = edges[first + a].visits
            bound = math.inf
            if n > 0:
                bound = edges[first + a].value + exploration * math.sqrt(log / n)
            if best < 0 or bound > most:
                best, most = a, bound
        a += 1
        if a == n_actions:
            a = 0
    return best


@inlined
def _expect(edges: Records, first: int, options: NDArray[np.int32], count: int, hope: float) -> None:
    """Begin a history with some visits of its ``count`` preferred actions that were worth ``hope``."""
    for j in range(count):
        edges[first + options[j]].visits = _PRIOR_VISITS
        edges[first + options[j]].value = hope


@inlined
def _back_up(
    nodes: Records,
    edges: Records,
    n_actions: int,
    discount: float,
    taken: NDArray[np.int64],
    paid: NDArray[np.float64],
    below: int,
    total: float,
) -> None:
    """Count a simulation in the means of its ``below`` steps in the tree; ``total`` is what came after them."""
    for d in range(below - 1, -1, -1):
        total = paid[d] + discount * total
        edge = taken[d]
        nodes[edge // n_actions].visits += 1
        edges[edge].visits += 1
        edges[edge].value += (total - edges[edge].value) / edges[edge].visits


@inlined
def _options(p: Preferences, s: Scratch, v: int) -> int:
    """How many preferred actions there are, written to ``s.options``; 0 where the domain has no rule."""
    if len(p.here) > 0:
        return preferred(p.here, p.closer, p.right, p.sample, p.check, v, s.tally, s.readings, s.options)
    return 0


@compiled
def _descend(
    m: Model, p: Preferences, nodes: Records, edges: Records, s: Scratch, state: NDArray[np.uint64], exploration: float
) -> tuple[int, int, int, bool]:
    """Go down the tree to a history that is not in it: what is visible there, what was read last, after how many
    steps, and whether the simulation goes on."""
    choices, rows, outcomes, reading_cdf, allowed = m.choices, m.rows, m.outcomes, m.reading_cdf, m.allowed
    n_actions, horizon, values, taken, paid, sensors = m.n_actions, m.horizon, s.values, s.taken, s.paid, m.sensors
    here, weight, sample, check, good, tally, readings = (
        p.here,
        p.weight,
        p.sample,
        p.check,
        p.good,
        s.tally,
        s.readings,
    )
    v, o, node, depth, running = nodes[0].visible, -1, 0, 0, True
    while node >= 0:
        first = node * n_actions
        a = _select(edges, first, allowed, v * n_actions, n_actions, nodes[node].visits, exploration, state)
        va = v * n_actions + a
        i, left = draw_outcome(rows, outcomes, row_of(choices, va, values, 0), next_uniform(state))
        if choices[va].factor >= 0:
            values[0, choices[va].factor] = outcomes[i].value
        o = draw_reading(reading_cdf, outcomes[i].reading, left)
        if sensors is not None:
            there, q = outcomes[i].visible * n_actions + a, outcomes[i].reading
            o = draw_labels(sensors, m.reading_probability, reading_cdf, q, o, left, there, values, 0)
        taken[depth], paid[depth] = first + a, outcomes[i].reward
        if len(here) > 0:
            note(here, weight, sample, check, good, v, a, o, tally, readings)
        v = outcomes[i].visible
        depth += 1
        running = not outcomes[i].ends and depth < horizon
        node = child_of(nodes, edges, first + a, v, o) if running else -1
    return v, o, depth, running


@compiled
def _play_on(m: Model, p: Preferences, s: Scratch, state: NDArray[np.uint64], v: int, steps: int) -> float:
    """Discounted return of a rollout by preferred actions, legal ones where there is none, from visible value ``v``."""
    ways, choices, rows, outcomes, reading_cdf = m.ways, m.choices, m.rows, m.outcomes, m.reading_cdf
    n_actions = m.n_actions
    here, closer, weight, right, sample, check, good = p.here, p.closer, p.weight, p.right, p.sample, p.check, p.good
    values, options, tally, readings = s.values, s.options, s.tally, s.readings
    total, worth = 0.0, 1.0
    for _ in range(steps):
        count = preferred(here, closer, right, sample, check, v, tally, readings, options)
        if count > 0:
            a = int(options[int(next_uniform(state) * count)])
        else:
            a, state[0] = random_legal(ways, choices, rows, n_actions, v, values, state[0])
        va = v * n_actions + a
        i, left = draw_outcome(rows, outcomes, row_of(choices, va, values, 0), next_uniform(state))
        if choices[va].factor >= 0:
            values[0, choices[va].factor] = outcomes[i].value
        o = draw_reading(reading_cdf, outcomes[i].reading, left)
        note(here, weight, sample, check, good, v, a, o, tally, readings)
        total += worth * outcomes[i].reward
        worth *= m.discount
        v = outcomes[i].visible
        if outcomes[i].ends:
            break
    return total


@compiled
def _beyond(m: Model, p: Preferences, s: Scratch, state: NDArray[np.uint64], v: int, steps: int) -> float:
    """Discounted return of a rollout from a new history: by preferred actions, or by legal ones where none are."""
    if len(p.here) > 0:
        return _play_on(m, p, s, state, v, steps)
    a, state[0] = random_legal(m.ways, m.choices, m.rows, m.n_actions, v, s.values, state[0])
    return random_return(
        m.ways, m.choices, m.rows, m.outcomes, m.n_actions, m.discount, steps, v, a, s.values, state
    )  # fmt: skip


@compiled
def _plan(
    m: Model,
    p: Preferences,
    nodes: Records,
    edges: Records,
    used: int,
    marginals: NDArray[np.float64],
    state: NDArray[np.uint64],
    tally: NDArray[np.int16],
    readings: NDArray[np.int16],
    simulations: int,
    exploration: float,
    hope: float,
) -> int:
    """Add simulations to one episode's tree, from its belief ``marginals[0]``; how many nodes there are then."""
    s = _scratch(m, tally, readings)
    if nodes[0].visits == 0:
        _expect(edges, 0, s.options, _options(p, s, nodes[0].visible), hope)
    for _ in range(simulations):
        draw_hidden(m.factor_offset, marginals, 0, state, s.values)
        s.tally[:] = tally
        s.readings[:] = readings
        v, o, below, running = _descend(m, p, nodes, edges, s, state, exploration)
        if running and used < len(nodes):
            add_node(nodes, edges, m.n_actions, used, s.taken[below - 1], v, o, -1)
            _expect(edges, used * m.n_actions, s.options, _options(p, s, v), hope)
            used += 1
        total = _beyond(m, p, s, state, v, m.horizon - below) if running else 0.0
        _back_up(nodes, edges, m.n_actions, m.discount, s.taken, s.paid, below, total)
    return used


@inlined
def _scratch(m: Model, tally: NDArray[np.int16], readings: NDArray[np.int16]) -> Scratch:
    values = np.zeros((1, len(m.factor_offset) - 1), dtype=np.int16)
    options, taken = np.zeros(m.n_actions, dtype=np.int32), np.zeros(m.horizon, dtype=np.int64)
    return Scratch(values, options, tally.copy(), readings.copy(), taken, np.zeros(m.horizon))
