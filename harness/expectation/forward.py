"""The expected return of a policy: its situations expanded step by step, equal ones merged."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness import policy as policies
from harness import registry
from harness.errors import check_whole
from harness.expectation.acting import Actor, NotExact
from harness.expectation.expanding import expand, ways
from harness.expectation.merging import merge
from harness.expectation.situations import Layer, first_layer, visible_of
from harness.expectation.sums import Exact, Sums
from harness.model.domain import Domain
from harness.model.tables import STOP
from harness.play.evaluation import HORIZON, check_played
from harness.policy import Policy
from harness.progress import Bar, Progress

MEMORY = 2_000_000_000
"""Bytes that the situations of a step may take."""
_LEAST_MEMORY, _MOST_MEMORY = 10_000, 2**50
_BESIDES = 48
"""Bytes that a situation takes for a while: the row it comes from, the tables of merging."""


def exact(
    domain: Domain | str,
    policy: Policy | str,
    *,
    horizon: int = HORIZON,
    memory: int = MEMORY,
    progress: Progress = False,
) -> Exact:
    """The expected return of a policy, with no sampling error.

    All situations that the policy can be in are expanded step by step, each with its probability. The work grows with
    the number of different situations of a step; where they need more than ``memory``, the least likely ones are left,
    and the result is an interval: at most they earn what can be had with everything observed, at least the worst.

    Args:
        domain: a domain or its name; its shaping counts.
        policy: a policy string, or an object that says in ``memory`` by which attributes it remembers
            (:class:`~harness.policy.base.Policy`). It must make no random choices.
        horizon: steps after which an episode is truncated.
        memory: bytes for the situations of one step.
        progress: True for a bar of the steps on a terminal, or a function told of every step.

    Raises:
        NotExact: the policy draws random numbers, or does not say what it remembers.
        HarnessError: an argument is wrong.
    """
    domain = registry.load(domain) if isinstance(domain, str) else domain
    check_played(seed=0, horizon=horizon)
    check_whole("memory", memory, _LEAST_MEMORY, _MOST_MEMORY)
    name, made = policies.named(policy, domain)
    try:
        actor = Actor(domain, made)
        with Bar(progress, horizon, desc=name, unit="step", delay=2) as bar:
            return _Forward(domain, actor, horizon, memory).run(name, bar)
    except NotExact as error:
        raise NotExact(f"{name} has no exact return: {error}") from None


class _Forward:
    """One computation: what the steps so far have earned."""

    def __init__(self, domain: Domain, actor: Actor, horizon: int, memory: int) -> None:
        self.domain, self.actor, self.horizon = domain, actor, horizon
        self.memory = memory
        self.ways = ways(domain.tables)
        self.sums = Sums(domain, horizon)

    def run(self, name: str, bar: Bar) -> Exact:
        """To the horizon, or until no situation is left."""
        layer = self.actor.begin(self.sums.started(first_layer(self.domain)))
        for step in range(self.horizon):
            if not len(layer.mass):
                break
            layer = self._step(layer, step)
            bar.update(1)
        return self.sums.result(name)

    def _step(self, layer: Layer, step: int) -> Layer:
        actions, watched = self.actor.act(layer.key, step)
        seen = layer.key[:, -1 - self.domain.n_marginals]
        counts = self.ways[visible_of(seen) * self.domain.n_actions + np.maximum(actions, 0)]
        counts[actions == STOP] = 0
        if counts.sum() > (room := self._room(layer)):
            most_likely = np.argsort(-layer.mass, kind="stable")
            fits = np.zeros(len(counts), dtype=np.bool_)
            fits[most_likely] = np.cumsum(counts[most_likely]) <= room
            self.sums.leave(Layer(layer.key[~fits], layer.mass[~fits]), step)
            layer, actions, watched = Layer(layer.key[fits], layer.mass[fits]), actions[fits], watched[fits]
            counts = counts[fits]
        return self._expanded(layer, actions, watched, int(counts.sum()) + 1)  # the one: see expand

    def _room(self, layer: Layer) -> int:
        """Situations that a step may have: they lie in memory together with those that they come from."""
        each = 2 * (8 * layer.key.shape[1] + 8 + len(self.domain.factors)) + _BESIDES
        return self.memory // each

    def _expanded(self, layer: Layer, actions: NDArray[np.int32], watched: NDArray[np.bool_], room: int) -> Layer:
        key, mass = np.empty((room, layer.key.shape[1]), dtype=np.int64), np.empty(room)
        parents = np.empty(room, dtype=np.int64)
        rewards, ended = np.empty(len(layer.mass)), np.empty(len(layer.mass))
        count = expand(self.domain.tables, *layer, actions, key, mass, parents, rewards, ended)
        heirs = watched[parents[:count]]
        merged, most = merge(key[:count], mass[:count], heirs, self.domain.factor_offset)
        self.sums.step(float(layer.mass[actions != STOP].sum()), float(rewards.sum()), float(ended.sum()))
        self.sums.merged(len(layer.mass), most, not watched.all())
        return Layer(key[:merged], mass[:merged])
