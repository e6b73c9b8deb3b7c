"""Makes the teams that are kept with the package: what a joint policy loses where nobody tells what he reads.

Every agent plays its part of the joint policy as if all had read what it reads itself. That is a controller of an
agent's own: a node is a joint belief before the reading, the reading (taken for everybody's) gives the joint belief and
the joint action, and its own part of this is done. Where all read the same they stay together; where not, each goes on
in a world of its own. (Executing a joint policy without communication: M. Roth, R. Simmons and M. Veloso, AAMAS 2005,
keep all joint beliefs that are possible instead of one.)

    python benchmarks/teams.py DOMAIN [ALPHA-VECTORS.npz]

writes ``harness/data/programs/DOMAIN/team.json`` and says what it earns. It takes a domain whose agents' readings have
the same names, and whose visible part, where readings are the same, is decided by the actions. (The team of
``dec-bordercross-7x8``, where nothing is hidden, was written by hand.)
"""

from __future__ import annotations

import json
import sys
from collections import defaultdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

import harness
from harness import registry
from harness.engine.batch import Batch
from harness.model.agents import action_strides, local_view, own_observations
from harness.policy import make
from harness.policy.fsc import Nodes, to_record

FLOOR = 1e-4
"""Probabilities below which a belief lets a value go: otherwise there are many more nodes."""
_MOST = 5_000  # nodes

Ways = dict[tuple[int, int], float]
"""Probabilities of a value of the hidden factor and the row of its reading."""


class Consensus:
    """The nodes of all agents' controllers, which differ in their part of the joint action only."""

    def __init__(self, domain: harness.Domain, joint: Any) -> None:
        self.domain, self.joint = domain, joint
        every = own_observations(domain, np.arange(domain.n_observations, dtype=np.int32))
        self.alike = [np.flatnonzero((every == o).all(axis=0))[0] for o in range(len(domain.agents[0].observations))]
        """Index of the joint observation in which all read the same."""
        self.nodes: list[tuple[int, Ways]] = []
        self.known: dict[Any, int] = {}
        t = domain.arrays
        prior = t["prior_marginals"][0] if domain.factors else np.ones(1)
        rows = t["prior_observation"][0] if domain.factors else t["start_observation"]
        self.node(int(t["prior_visible"][0]), {(int(x), int(rows[x])): float(prior[x]) for x in np.flatnonzero(prior)})

    def node(self, visible: int, ways: Ways) -> int:
        """The number of a node, which is new where there is none like it."""
        total = sum(ways.values())
        ways = {way: p / total for way, p in sorted(ways.items())}
        key = visible, tuple((way, round(p, 9)) for way, p in ways.items())
        if key not in self.known:
            self.known[key] = len(self.nodes)
            self.nodes.append((visible, ways))
        return self.known[key]

    def rules(self, node: int) -> list[tuple[int, int]]:
        """The joint action and the next node for each reading; for an impossible one those of the nearest possible."""
        ways, t = self.nodes[node][1], self.domain.arrays["observation_probability"]
        chance = np.array([sum(p * t[q, o] for (_, q), p in ways.items()) for o in self.alike])
        possible = np.flatnonzero(chance > 0)
        return [self._rule(node, possible[np.abs(possible - o).argmin()]) for o in range(len(self.alike))]

    def _rule(self, node: int, reading: int) -> tuple[int, int]:
        visible, ways = self.nodes[node]
        t = self.domain.arrays["observation_probability"]
        belief = np.zeros(max(1, self.domain.n_marginals))
        for (x, q), p in ways.items():
            belief[x] += p * t[q, self.alike[reading]]
        belief /= belief.sum()
        belief[belief < FLOOR] = 0
        belief /= belief.sum()
        action = self._act(visible, belief)
        following = self._step(visible, belief, action)
        if not following:  # it should be over; who is still there tries again
            return action, node
        (after, ways), *others = following.items()
        if others:
            raise SystemExit(f"{self.domain.name}: what is visible is not decided by the actions")
        return action, self.node(after, ways)

    def _act(self, visible: int, belief: NDArray[np.float64]) -> int:
        one = np.array([visible], dtype=np.int32)
        marginals = belief[None, : self.domain.n_marginals]
        return int(self.joint.act(Batch(self.domain, one, one, marginals, np.zeros(1, dtype=np.bool_), 0, 0))[0])

    def _step(self, visible: int, belief: NDArray[np.float64], action: int) -> dict[int, Ways]:
        t, found = self.domain.arrays, defaultdict[int, Ways](dict)
        first = t["first_row"][visible * self.domain.n_actions + action]
        for x in np.flatnonzero(belief):
            for j in range(t["row_outcomes"][first + x], t["row_outcomes"][first + x + 1]):
                if not t["terminal"][v := int(t["outcome_visible"][j])]:
                    way = int(t["outcome_value"][j]), int(t["outcome_observation"][j])
                    found[v][way] = found[v].get(way, 0.0) + belief[x] * t["outcome_probability"][j]
        return found

    def controllers(self) -> list[dict[str, Any]]:
        """One for each agent."""
        rules, at = [], 0
        while at < len(self.nodes):
            rules.append(self.rules(at))
            at += 1
            if at > _MOST:
                raise SystemExit(f"more than {_MOST:,} nodes")
        joint, following = np.moveaxis(np.array(rules, dtype=np.int32), 2, 0)
        return [self._controller(i, joint, following) for i in range(len(self.domain.agents))]

    def _controller(self, agent: int, joint: NDArray[np.int32], following: NDArray[np.int32]) -> dict[str, Any]:
        view = local_view(self.domain, agent)
        own = joint // action_strides(self.domain)[agent] % view.n_actions
        with_none = [np.hstack([table[:, :1], table]) for table in (own, following)]  # nobody acts without a reading
        return to_record(Nodes(0, *(table[:, None].repeat(view.n_visible, axis=1) for table in with_none)), view)


def main(name: str, vectors: str = "") -> None:
    """Make the team of a domain."""
    domain = harness.load(name)
    joint = make(f"alpha:{vectors}" if vectors else "solved", domain)[1]
    made = Consensus(domain, joint).controllers()
    record = {
        "about": "each agent plays the joint policy as if all had read what it reads (benchmarks/teams.py)",
        "domain": domain.name,
        "domain_version": domain.version,
        "model_hash": domain.model_hash,
        "members": made,
    }
    path = registry.program_path(name, "team")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
    print(f"{path}: {len(made[0]['nodes'])} nodes")
    print(harness.exact(name, "team"))


if __name__ == "__main__":
    main(*sys.argv[1:])
