"""Episodes as compact data for the page's player."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness import policy as policies
from harness import registry
from harness.errors import HarnessError
from harness.model.domain import Domain
from harness.policy import Policy
from harness.policy.program import ProgramPolicy
from harness.policy.team import policy_of
from harness.program import parse, words_of
from harness.report.hidden import hidden
from harness.report.programs import lines_of
from harness.show import replay as show

ENGINE = "tables"
"""Both engines play the same episodes; this one needs no Julia."""

_SCALE = 1000  # beliefs are kept in thousandths
_MOST_STEPS = 10_000  # of an episode, which the page holds whole


@dataclass(frozen=True)
class Wanted:
    """A policy whose episodes are to be replayed."""

    label: str
    """What the page calls it."""
    domain: str
    """Its name, or how it is loaded."""
    seed: int
    horizon: int
    spec: str = ""
    """A policy string; empty for a program."""
    program: str = ""
    """A program's text."""
    version: int | None = None
    """Of the domain that the results are of, where it is known."""
    model_hash: str | None = None
    """Of the domain that the results are of, where it is known."""


class Domains:
    """Domains by name: those that were given, then those that ship with the package."""

    def __init__(self, given: Sequence[Domain | str] = (), allow_code: bool = False) -> None:
        """``given``: domains, or how they are loaded; ``allow_code``: files that the results name may be used."""
        self.allow_code = allow_code
        self._by_name: dict[str, Domain] = {}
        for each in given:  # results of a file's domain name the domain or the file
            loaded = registry.load(each) if isinstance(each, str) else each
            self._by_name |= {loaded.name: loaded, str(each) if isinstance(each, str) else loaded.name: loaded}

    def find(self, wanted: Wanted) -> Domain:
        """The domain that a policy's results are of, with the true reward.

        Raises:
            HarnessError: it is not to be had, or is no longer the same.
        """
        known, name = self._by_name, wanted.domain
        domain = known[name] if name in known else registry.load_from_data(name, self.allow_code)
        if wanted.version not in (None, domain.version) or wanted.model_hash not in (None, domain.model_hash):
            raise HarnessError(f"the results are of another version of {domain.name} than today's")
        return domain.shaped("none")


def replays(wanted: Sequence[Wanted], domains: Domains, episodes: int) -> tuple[dict[str, Any] | None, list[str]]:
    """What the player needs for policies on one domain, None where there is nothing to play, and why some are missing.

    ``episodes``: the first so many of each policy's seed.
    """
    played, missing, drawn = [], [], None
    for each in wanted if episodes else ():
        try:
            domain = domains.find(each)
            policy = _policy(each, domain, domains.allow_code)
            shown = [episode(domain, policy, each.seed, k, _horizon(each)) for k in range(episodes)]
        except HarnessError as error:
            missing.append(f"No replay of {each.label}: {error}.")
            continue
        drawn = domain
        used = getattr(policy, "uses_belief", True)
        lines = lines_of(policy.program.text) if isinstance(policy, ProgramPolicy) else None
        about = {"name": each.label, "uses_belief": used, "program": lines, "seed": str(each.seed)}
        played.append({**about, "episodes": shown})
    return ({"domain": _described(drawn), "policies": played} if drawn else None), missing


def _horizon(wanted: Wanted) -> int:
    if wanted.horizon > _MOST_STEPS:
        raise HarnessError(f"a page shows episodes of {_MOST_STEPS:,} steps at most, and these may have more")
    return wanted.horizon


def _policy(wanted: Wanted, domain: Domain, allow_code: bool) -> Policy:
    if wanted.program:
        return policy_of(parse(wanted.program, words_of(domain), source=wanted.label))
    return policies.make_from_data(wanted.spec, domain, allow_code)[1]


def _described(domain: Domain) -> dict[str, Any]:
    """What of a domain is needed to draw it; ``cells`` says which features are about a cell, and which one."""
    return {
        "name": domain.name,
        "actions": domain.actions,
        "observations": domain.observations,
        "sensors": [sensor.labels for sensor in domain.sensors],
        "discount": domain.discount,
        "visible": domain.visible_names,
        "factors": domain.factors,
        "layout": dict(sorted(domain.layout.items())),
        "features": [_label(domain, i) for i in range(len(domain.features))],
        "cells": [_cell(domain, k, x) for _, k, x in domain.features],
        "many": show.MANY_FEATURES,
    }


def _label(domain: Domain, i: int) -> str:
    """As ``harness show`` says it, but a rock by the number that ``check`` takes: there is room for two digits."""
    return domain.factors[domain.features[i][1]] if domain.layout["kind"] == "rocksample" else show.label(domain, i)


def _cell(domain: Domain, factor: int, value: int) -> list[int] | None:
    """Row and column that a value stands for: by the layout, or as its label says them, ``(4, 1)``."""
    if placed := domain.layout.get("hidden_cells"):
        return list(reversed(placed[value]))
    parts = domain.factor_labels[factor][value].strip("()").split(",")
    return (
        [int(part) for part in parts] if len(parts) == 2 and all(part.strip().isdecimal() for part in parts) else None
    )


class _Watched:
    """A policy whose episodes show the belief, although the policy does not look at it."""

    def __init__(self, policy: Policy) -> None:
        self.reset, self.act = policy.reset, policy.act


def episode(domain: Domain, policy: Policy, seed: int, number: int, horizon: int) -> dict[str, Any]:
    """An episode as columns with an entry for the start and for every step.

    ``action`` and ``reading`` are indices (−1: none), ``visible`` the visible values, ``belief`` the features that have
    changed since the entry before, as index, thousandths, index, thousandths, …; of a program, ``line`` is the line
    that the action came from (−1: none). Besides, ``hidden`` is the true hidden state (:mod:`harness.report.hidden`).
    """
    columns: dict[str, list[Any]] = {"action": [], "reading": [], "reward": [], "visible": [], "belief": []}
    follow = ProgramPolicy(policy.program) if isinstance(policy, ProgramPolicy) else None
    lines: list[int] = [-1]
    before = np.full(len(domain.features), -1)
    for step in show.steps(domain, _Watched(policy), ENGINE, seed, number, horizon):
        read = show.reading(step.batch)
        belief = np.rint(step.batch.features[0] * _SCALE).astype(np.int64)
        columns["action"].append(-1 if step.action is None else step.action)
        columns["reading"].append(-1 if read is None else read)
        columns["reward"].append(int(step.reward) if step.reward.is_integer() else step.reward)
        columns["visible"].append(list(show.position(step.batch).values()))
        columns["belief"].append(_changes(before, belief))
        before = belief
        if follow:
            lines.append(_next_line(follow, step))
    if follow:
        columns["line"] = lines[:-1]  # after the last entry no action came
    how = {"terminated": bool(step.batch.done[0]), "ending": show.ending(step, horizon)}
    true = hidden(domain, columns["action"][1:], seed, number)
    return {"episode": number, **how, "hidden": true, **columns}


def _next_line(follow: ProgramPolicy, step: show.Step) -> int:
    """Line of the operation that a program takes next, −1 for none; ``follow`` runs it on what its policy has seen."""
    if step.action is None:
        follow.reset(step.batch)
    follow.act(step.batch)
    at = follow.at[0]
    return int(follow.program.line_of[at]) if at >= 0 else -1


def _changes(before: NDArray[np.int64], after: NDArray[np.int64]) -> list[int]:
    changed = np.flatnonzero(before != after)
    pairs: list[int] = np.stack([changed, after[changed]], axis=1).ravel().tolist()
    return pairs
