"""Finite-state controllers in files: a few nodes of memory, each with rules for what is seen (Hansen 1998).

As JSON a controller names its first node, and for every node its rules. Of these the first that fits decides::

    {"start": "search",
     "nodes": {"search": [{"visible": {"x": 1}, "reading": "good", "do": "up()", "go": "leave"},
                          {"do": "check(1)"}],
               "leave": [{"do": "right()"}]}}

``visible`` and ``reading`` are what must be seen now, any where left out; ``do`` is the action, ``stop`` to end; ``go``
the next node, the same where left out. The last rule of a node has no conditions, so that one always fits. Controllers
that PAYNT writes are read too (:func:`read_controller`).
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness import files
from harness.engine.batch import Batch
from harness.errors import PolicyError, nearest, quoted
from harness.formats import naming
from harness.model.domain import Domain
from harness.model.tables import STOP
from harness.policy.base import fitting

_MOST = 50_000_000
"""Entries of a controller's table at most: nodes · visible values · readings."""


class Nodes(NamedTuple):
    """A controller as tables over (node, visible value, reading + 1), M × V × (O + 1)."""

    start: int
    action: NDArray[np.int32]
    next: NDArray[np.int32]

    def __deepcopy__(self, memo: object) -> Nodes:
        """Itself: nobody writes to it, so copies of a policy share it."""
        return self


class FileController:
    """Acts by its node and what it sees, and moves on to the node that these name."""

    uses_belief = False
    memory = ("_node",)

    def __init__(self, domain: Domain, nodes: Nodes) -> None:
        """``nodes``: over the visible values and readings of the domain.

        Raises:
            PolicyError: they are of another domain.
        """
        if nodes.action.shape[1:] != (domain.n_visible, domain.n_observations + 1):
            raise PolicyError(f"the controller was made for another domain than {domain.name}")
        self.nodes = nodes

    def reset(self, batch: Batch) -> None:
        """All episodes begin at the start node."""
        self._node = np.full(batch.size, self.nodes.start, dtype=np.int32)

    def act(self, batch: Batch) -> NDArray[np.int32]:
        """One action an episode."""
        at = fitting(batch, self._node), batch.visible, batch.observation + 1
        actions = self.nodes.action[at]
        going = (actions != STOP) & ~batch.done
        self._node = np.where(going, self.nodes.next[at], self._node)
        return actions


def read_controller(path: Path, domain: Domain) -> Nodes:
    """Read a controller: JSON of the form above, or as PAYNT writes it (``action_function`` and ``update_function``).

    PAYNT is given a domain as a ``.pomdp`` file (``harness export``), whose spelling of actions and readings its
    controller has. There a first step ``init``, which is none of the domain's, draws the state.

    Raises:
        PolicyError: the file is no controller of the domain; the message says where.
    """
    try:
        record = json.loads(files.read_source(path, PolicyError))
    except ValueError as error:
        raise PolicyError(f"{path}: not JSON: {error}") from None
    try:
        return of_record(record, domain)
    except PolicyError as error:
        raise PolicyError(f"{path}: {error}") from None


def of_record(record: Any, domain: Domain) -> Nodes:
    """The controller of a file's JSON, as :func:`read_controller`."""
    if not isinstance(record, dict):
        raise PolicyError("a controller is an object with start and nodes")
    return _of_paynt(record, domain) if "action_function" in record else _of_rules(record, domain)


def to_record(nodes: Nodes, domain: Domain) -> dict[str, Any]:
    """The JSON of a controller, as :func:`read_controller` reads it.

    Before the first reading a node does what its rules say without one. Only the start node is taken to be there then.
    """
    named = enumerate(zip(nodes.action, nodes.next, strict=True))
    return {
        "start": str(nodes.start),
        "nodes": {str(i): _rules_of(*node, i == nodes.start, domain) for i, node in named},
    }


def _rules_of(
    action: NDArray[np.int32], following: NDArray[np.int32], begins: bool, domain: Domain
) -> list[dict[str, Any]]:
    """The rules of a node: readings alone where what is visible decides nothing; the most common at last."""
    alive = np.flatnonzero(~domain.tables.terminal).tolist()
    kinds = [list(zip(*rows, strict=True)) for rows in zip(action.tolist(), following.tolist(), strict=True)]
    usual = {v: kinds[v][0] if begins else _commonest(kinds[v][1:]) for v in alive}
    alike = all(kinds[v][1:] == kinds[alive[0]][1:] and usual[v] == usual[alive[0]] for v in alive)
    last = _commonest(list(usual.values()))
    rules = []
    for v in alive[:1] if alike else alive:
        seen = zip(domain.visible_names, domain.visible_values[v].tolist(), strict=True)
        place = {} if alike else {"visible": dict(seen)}
        for o, name in enumerate(domain.observations):
            if kinds[v][o + 1] != usual[v]:
                rules.append({**place, "reading": name, **_done(kinds[v][o + 1], domain)})
        if usual[v] != last:
            rules.append({**place, **_done(usual[v], domain)})
    return [*rules, _done(last, domain)]


def _commonest(kinds: list[tuple[int, int]]) -> tuple[int, int]:
    return max(dict.fromkeys(kinds), key=kinds.count)


def _done(kind: tuple[int, int], domain: Domain) -> dict[str, Any]:
    action, node = kind
    return {"do": "stop"} if action == STOP else {"do": domain.actions[action], "go": str(node)}


def _of_rules(record: dict[str, Any], domain: Domain) -> Nodes:
    nodes, start = record.get("nodes"), record.get("start")
    if not isinstance(nodes, dict) or not nodes:
        raise PolicyError("nodes must be an object with at least one node: a name, and a list of rules")
    action, following = _tables(len(nodes), domain)
    numbers = {name: i for i, name in enumerate(nodes)}
    for name, rules in nodes.items():
        if not isinstance(rules, list) or not rules or not all(isinstance(rule, dict) for rule in rules):
            raise PolicyError(f"node {quoted(name)} must be a list of rules")
        if {"visible", "reading"} & set(rules[-1]):
            raise PolicyError(f"node {quoted(name)}: its last rule must have no conditions, so that one always fits")
        for rule in reversed(rules):
            where = f"node {quoted(name)}, rule {rules.index(rule) + 1}"
            _put(rule, where, numbers[name], numbers, domain, action, following)
    return Nodes(_node(start, numbers, "start"), action, following)


def _put(
    rule: dict[str, Any],
    where: str,
    node: int,
    numbers: dict[str, int],
    domain: Domain,
    action: NDArray[np.int32],
    following: NDArray[np.int32],
) -> None:
    """One rule, over those that come after it."""
    for key in rule:
        if key not in (known := ("visible", "reading", "do", "go")):
            raise PolicyError(f"{where}: no key {quoted(key)}{nearest(key, known)} (known: {', '.join(known)})")
    at = np.ix_(np.array([node]), _visible(rule.get("visible", {}), where, domain), _readings(rule, where, domain))
    do = rule.get("do")
    if do != "stop" and do not in domain.actions:
        raise PolicyError(f"{where}: do must be an action of {domain.name} or stop, not {quoted(do)}")
    action[at] = STOP if do == "stop" else domain.actions.index(do)
    following[at] = _node(rule["go"], numbers, f"{where}: go") if "go" in rule else node


def _visible(wanted: Any, where: str, domain: Domain) -> NDArray[np.intp]:
    """The visible values that a condition names."""
    if not isinstance(wanted, dict):
        raise PolicyError(f"{where}: visible must be an object such as {{{', '.join(domain.visible_names)}: …}}")
    fits = np.ones(domain.n_visible, dtype=np.bool_)
    for name, value in wanted.items():
        if name not in domain.visible_names or not isinstance(value, int):
            raise PolicyError(
                f"{where}: visible has no whole number {quoted(name)} ({', '.join(domain.visible_names)})"
            )
        fits &= domain.visible_values[:, domain.visible_names.index(name)] == value
    return np.flatnonzero(fits)


def _readings(rule: dict[str, Any], where: str, domain: Domain) -> NDArray[np.intp]:
    """The columns of a rule's reading; the first one stands for no reading yet."""
    if "reading" not in rule:
        return np.arange(domain.n_observations + 1)
    if rule["reading"] not in domain.observations:
        known = ", ".join(domain.observations)
        raise PolicyError(f"{where}: no reading {quoted(rule['reading'])} (known: {known})")
    return np.array([domain.observations.index(rule["reading"]) + 1])


def _node(name: Any, numbers: dict[str, int], where: str) -> int:
    if not isinstance(name, str) or name not in numbers:
        raise PolicyError(f"{where} must be one of the nodes, not {quoted(name)}")
    return numbers[name]


def _tables(nodes: int, domain: Domain) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    shape = (nodes, domain.n_visible, domain.n_observations + 1)
    if np.prod(shape, dtype=np.float64) > _MOST:
        raise PolicyError(f"{nodes:,} nodes are too many for {domain.name}")
    return np.full(shape, STOP, dtype=np.int32), np.zeros(shape, dtype=np.int32)


_OF_PAYNT = ("action_function", "update_function", "num_nodes", "num_observations")


_INIT, _NOTHING = "init", "__no_obs__"  # PAYNT's own observations: at its first step, and after it


def _of_paynt(record: dict[str, Any], domain: Domain) -> Nodes:
    does, goes, count, seen = (record.get(name) for name in _OF_PAYNT)
    if (
        not isinstance(does, list)
        or not isinstance(goes, list)
        or not isinstance(count, int)
        or not (_is_table(does, count, seen) and _is_table(goes, count, seen))
    ):
        raise PolicyError("action_function and update_function must be lists of num_nodes lists of num_observations")
    labels = record.get("observation_labels")
    if not isinstance(labels, list) or len(labels) != seen:
        raise PolicyError("observation_labels must be a list of num_observations names")
    spelled, actions = _spelled_readings(domain), _spelled_actions(domain)
    action, following = _tables(count, domain)
    for z, label in enumerate(labels):
        if label == _INIT and label not in spelled:
            continue
        if label not in spelled:
            raise PolicyError(f"{quoted(label)} is no reading of {domain.name} as `harness export` spells it")
        visible, column = spelled[label]
        for node in range(count):
            action[node, visible, column] = _action(does[node][z], record.get("action_labels"), actions, domain)
            following[node, visible, column] = _number(goes[node][z], count)
    start = _number(goes[0][labels.index(_INIT)], count) if _INIT in labels and _INIT not in spelled else 0
    return Nodes(start, action, following)


def _spelled_readings(domain: Domain) -> dict[Any, tuple[int | slice, int]]:
    """The visible values and the column that an observation of the domain's ``.pomdp`` file stands for, by its name."""
    everywhere = slice(None)
    spelled: dict[Any, tuple[int | slice, int]] = {_NOTHING: (everywhere, 0)}
    for o, name in enumerate(naming.identifiers(domain.observations, "o")):
        spelled |= {naming.shown(v, name): (v, o + 1) for v in range(domain.n_visible)}
        spelled |= {name: (everywhere, o + 1), domain.observations[o]: (everywhere, o + 1)}
    return spelled


def _is_table(table: Any, rows: Any, columns: Any) -> bool:
    return (
        isinstance(table, list) and len(table) == rows and all(isinstance(r, list) and len(r) == columns for r in table)
    )


def _spelled_actions(domain: Domain) -> dict[str, int]:
    """Actions by what PAYNT may call them: the names of the domain's ``.pomdp`` file, which it puts in brackets."""
    spelled = {name: a for a, name in enumerate(naming.identifiers(domain.actions, "a"))}
    own = {name: a for a, name in enumerate(domain.actions)}
    return {f"({name})": a for name, a in spelled.items()} | spelled | own


def _action(given: Any, labels: Any, actions: dict[str, int], domain: Domain) -> int:
    """An action by the number of its label; of a distribution the only one it has."""
    if isinstance(given, dict):
        if len(given) != 1:
            raise PolicyError("its actions are random; a controller with one action a node and observation is needed")
        given = next(iter(given))
    if given is None:
        return STOP
    number = int(given) if isinstance(given, int) or str(given).isdecimal() else -1
    if not isinstance(labels, list) or not 0 <= number < len(labels):
        raise PolicyError(f"action_labels names no action {quoted(given)}")
    label = str(labels[number])
    if label not in actions:
        raise PolicyError(f"{quoted(label)} is no action of {domain.name}")
    return actions[label]


def _number(given: Any, count: int) -> int:
    if given is None:
        return 0
    if not isinstance(given, int) or not 0 <= given < count:
        raise PolicyError(f"update_function names node {quoted(given)}; there are {count}")
    return given
