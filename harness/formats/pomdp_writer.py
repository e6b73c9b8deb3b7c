"""A domain as a ``.pomdp`` file: one state for every visible value and value of what is hidden.

The format knows nothing visible. Where an agent could not tell from its actions which visible value it is in, an
observation there is a visible value and a reading together.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from harness.errors import HarnessError
from harness.formats import limits, naming, outgoing
from harness.formats.outgoing import Arrows
from harness.model.domain import Domain
from harness.model.indexing import strides
from harness.model.joining import joined, joint_steps

Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class _Flat:
    """Where the states of a domain are in its file."""

    domain: Domain
    merged: bool
    """Whether what is terminal are values of the only factor."""
    first: Ints
    """(V,) a visible value's first state."""
    count: int
    shown: bool
    """Whether observations tell the visible value."""

    def state(self, visible: Ints, joint: Ints) -> Ints:
        """The states with these parts; a terminal visible value has one state only."""
        alone = self.domain.arrays["terminal"][visible] & (not self.merged)
        return self.first[visible] + np.where(alone, 0, joint)


def lines(domain: Domain) -> Iterator[str]:
    """The lines of the file.

    Raises:
        HarnessError: the format cannot say it, or there are too many states; say it as POMDPX.
    """
    outgoing.check(domain)
    domain = joined(domain)
    flat = _flat(domain)
    arrows = _arrows(flat)
    actions = naming.identifiers(domain.actions, "a")
    states = naming.identifiers(domain.factor_labels[0], "s") if flat.merged else [str(i) for i in range(flat.count)]
    yield f"# {domain.name}, version {domain.version}, written by harness export"
    yield f"discount: {domain.discount!r}\nvalues: reward"
    yield f"states: {' '.join(states) if flat.merged else flat.count}"
    yield f"actions: {' '.join(actions)}"
    yield f"observations: {' '.join(_observations(flat))}"
    yield f"start:\n{_words(_start(flat))}"
    yield from _transitions(flat, arrows, actions, states)
    yield from _readings(flat, arrows, actions, states)
    yield from _rewards(flat, arrows, actions, states)


def _words(numbers: NDArray[np.float64]) -> str:
    return " ".join(map(repr, numbers.tolist()))


def _flat(domain: Domain) -> _Flat:
    terminal, merged = domain.arrays["terminal"], outgoing.is_flat(domain)
    size = np.where(terminal, 0 if merged else 1, domain.n_joint).astype(np.int64)
    first = np.zeros_like(size) if merged else np.cumsum(size) - size
    mend = "export it as pomdpx, whose tables are over the factors"
    limits.check(f"{domain.name}: states", int(size.sum()), limits.LARGEST_FACTOR, mend)
    return _Flat(domain, merged, first, int(size.sum()), not merged and not _is_known(domain))


def _is_known(domain: Domain) -> bool:
    """Whether the actions tell which visible value an agent is in, as long as nothing has ended.

    Raises:
        HarnessError: they do not, and it may begin in several.
    """
    t = domain.arrays
    choice = np.repeat(outgoing.row_choices(domain)[0], np.diff(t["row_outcomes"]))
    goes_on = ~t["terminal"][t["outcome_visible"]]
    ways = np.unique(np.column_stack([choice, t["outcome_visible"]])[goes_on], axis=0)
    several = (~t["terminal"][t["prior_visible"]]).sum() > 1
    if several:
        raise HarnessError(
            f"{domain.name}: which of several visible values it begins in is known before the first step; .pomdp files "
            "cannot say that; export it as pomdpx"
        )
    return len(np.unique(ways[:, 0])) == len(ways)


def _arrows(flat: _Flat) -> Arrows:
    """From action · states + state to the next state."""
    d, t = flat.domain, flat.domain.arrays
    choice, hidden, _, outcome, of, after = joint_steps(d)
    source = choice % d.n_actions * flat.count + flat.state(choice // d.n_actions, hidden)
    target = flat.state(t["outcome_visible"][outcome].astype(np.int64), after)
    reward = t["outcome_reward"][d.shapings.index(d.shaping)][outcome]
    ends = t["terminal"][t["outcome_visible"][outcome]] & (not flat.merged)
    reading = np.where(ends, 0, t["outcome_observation"][outcome])  # what is read at the end is of no use
    return outgoing.arrows(d.name, source[of], target, t["outcome_probability"][outcome], reward, reading)


def _start(flat: _Flat) -> NDArray[np.float64]:
    """(states,) the initial distribution."""
    d, t = flat.domain, flat.domain.arrays
    chances = np.zeros(flat.count)
    if len(t["prior_visible"]) == 1:
        belief = np.ones(1)
        for k in range(len(d.factors)):
            belief = np.outer(belief, t["prior_marginals"][0, d.factor_offset[k] : d.factor_offset[k + 1]]).ravel()
        np.add.at(chances, flat.state(np.repeat(t["prior_visible"], len(belief)), np.arange(len(belief))), belief)
        return chances
    joint = t["start_values"].astype(np.int64) @ strides(d.factor_sizes)
    np.add.at(chances, flat.state(t["start_visible"].astype(np.int64), joint), np.diff(t["start_cdf"], prepend=0.0))
    return chances


def _transitions(flat: _Flat, arrows: Arrows, actions: list[str], states: list[str]) -> Iterator[str]:
    if not flat.merged:
        for v in np.flatnonzero(flat.domain.arrays["terminal"]):
            yield f"T: * : {states[flat.first[v]]} : {states[flat.first[v]]} 1.0"
    a, s = np.divmod(arrows.source, flat.count)
    for i, j, k, p in zip(a.tolist(), s.tolist(), arrows.target.tolist(), arrows.probability.tolist(), strict=True):
        yield f"T: {actions[i]} : {states[j]} : {states[k]} {p!r}"


def _observations(flat: _Flat) -> list[str]:
    names = naming.identifiers(flat.domain.observations, "o")
    return [naming.shown(v, name) for v in range(flat.domain.n_visible) for name in names] if flat.shown else names


def _readings(flat: _Flat, arrows: Arrows, actions: list[str], states: list[str]) -> Iterator[str]:
    """Every reading that has a probability; in cases that no step leads to, the first one."""
    case = arrows.source // flat.count * flat.count + arrows.target
    cases, first = np.unique(case, return_index=True)
    reading = np.full(flat.domain.n_actions * flat.count, -1)
    reading[cases] = arrows.reading[first]
    if (arrows.reading != reading[case]).any():
        raise naming.readings_hang_on_more(flat.domain.name, "pomdp")
    names, of_visible = _observations(flat), _visible(flat) * len(flat.domain.observations)
    table = [
        [(o, p) for o, p in enumerate(row) if p > 0] for row in flat.domain.arrays["observation_probability"].tolist()
    ]
    for each, number in enumerate(reading.tolist()):
        a, s = divmod(each, flat.count)
        for o, p in table[number] if number >= 0 else [(0, 1.0)]:
            yield f"O: {actions[a]} : {states[s]} : {names[of_visible[s] + o]} {p!r}"


def _visible(flat: _Flat) -> Ints:
    """(states,) the visible value of each state, where observations tell it, else 0."""
    v = np.searchsorted(flat.first, np.arange(flat.count), "right") - 1
    return v if flat.shown else np.zeros_like(v)


def _rewards(flat: _Flat, arrows: Arrows, actions: list[str], states: list[str]) -> Iterator[str]:
    shown, alike = arrows.reward != 0, arrows.same_reward()
    once = np.zeros(len(shown), dtype=np.bool_)
    once[arrows.begins] = True
    a, s = np.divmod(arrows.source, flat.count)
    for i in np.flatnonzero(shown & (once | ~alike)).tolist():
        target = "*" if alike[i] else states[arrows.target[i]]
        yield f"R: {actions[a[i]]} : {states[s[i]]} : {target} : * {float(arrows.reward[i])!r}"
