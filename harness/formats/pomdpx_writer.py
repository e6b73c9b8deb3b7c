"""A domain as a POMDPX file: the visible part as one fully observed variable, every hidden factor as one of its own."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from harness.formats import naming, outgoing
from harness.formats.outgoing import Arrows
from harness.model.domain import Domain

_ANY, _EACH = "*", "-"
_ACTION, _READING = "action", "reading"


class _Variable(NamedTuple):
    """A variable of the state, as the file calls it and its values."""

    name: str
    values: list[str]

    @property
    def before(self) -> str:
        return f"{self.name}_0"

    @property
    def after(self) -> str:
        return f"{self.name}_1"


class _Way(NamedTuple):
    """An outcome: next visible value, next value of the factor, and what comes with them."""

    visible: int
    value: int
    probability: float
    reward: float
    reading: int
    pays_alike: bool
    """Whether all outcomes of its row pay the same."""


class _Row(NamedTuple):
    """All outcomes of an action at a visible value and a value of the factor that it touches."""

    action: int
    visible: int
    factor: int
    value: int
    ways: list[_Way]


@dataclass(frozen=True, eq=False)
class _Model:
    """A domain with the names that its file gives."""

    domain: Domain
    actions: list[str]
    readings: list[str]
    """Of the steps' own observations; empty where these tell nothing beside what sensors read."""
    sensors: list[_Variable]
    visible: _Variable | None
    """None where the state is one hidden factor."""
    factors: list[_Variable]
    rows: list[_Row]

    def given(self, action: str, visible: str) -> list[str]:
        """The beginning of an instance: the action and, where there is a visible variable, its value."""
        return [action, visible] if self.visible else [action]

    def at(self, visible: int) -> str:
        """Name of a visible value."""
        return self.visible.values[visible] if self.visible else ""


def lines(domain: Domain) -> Iterator[str]:
    """The lines of the file.

    Raises:
        HarnessError: the format cannot say it.
    """
    outgoing.check(domain)
    m = _model(domain)
    yield '<?xml version="1.0" encoding="UTF-8"?>'
    yield f'<pomdpx version="1.0" id={quoteattr(naming.tokens([domain.name], "x")[0])}>'
    yield f"<Description>{escape(domain.name)}, version {domain.version}, written by harness export</Description>"
    yield f"<Discount>{domain.discount!r}</Discount>"
    rewards = list(_rewards(m))
    yield from _variables(m, len(rewards))
    yield from _section("InitialStateBelief", _start(m))
    yield from _section("StateTransitionFunction", _moves(m))
    yield from _section("ObsFunction", _seen(m))
    yield from _section("RewardFunction", itertools.chain.from_iterable(rewards))
    yield "</pomdpx>"


def _section(name: str, inside: Iterable[str]) -> Iterator[str]:
    yield f"<{name}>"
    yield from inside
    yield f"</{name}>"


def _model(domain: Domain) -> _Model:
    count = len(domain.factors)
    names = naming.tokens([_ACTION, _READING, *domain.factors, *(f"sensor {s.name}" for s in domain.sensors)], "f")[2:]
    factors = [
        _Variable(name, naming.tokens(values, "s"))
        for name, values in zip(names[:count], domain.factor_labels, strict=True)
    ]
    sensors = [
        _Variable(name, naming.tokens(s.labels, "l")) for name, s in zip(names[count:], domain.sensors, strict=True)
    ]
    visible = None if outgoing.is_flat(domain) else _visible(domain, names)
    actions = naming.tokens(domain.actions, "a")
    return _Model(domain, actions, _own_readings(domain), sensors, visible, factors, _rows(domain))


def _own_readings(domain: Domain) -> list[str]:
    if not domain.sensors:
        return naming.tokens(domain.observations, "o")
    own = domain.n_observations // domain.n_labels
    return [f"o{i}" for i in range(own)] if own > 1 else []


def _visible(domain: Domain, taken: Sequence[str]) -> _Variable:
    name = domain.visible_names[0] if len(domain.visible_names) == 1 else "visible"
    spelled = [
        "_".join(f"{name}{value}" for name, value in zip(domain.visible_names, row, strict=True))
        for row in domain.visible_values.tolist()
    ]
    return _Variable(naming.tokens([*taken, name], "v")[-1], naming.tokens(spelled, "v"))


def _rows(domain: Domain) -> list[_Row]:
    t = domain.arrays
    choice, value = outgoing.row_choices(domain)
    row = np.repeat(np.arange(len(choice)), np.diff(t["row_outcomes"]))
    size = max(domain.factor_sizes, default=1)
    target = t["outcome_visible"].astype(np.int64) * size + t["outcome_value"]
    reward = t["outcome_reward"][domain.shapings.index(domain.shaping)]
    arrows = outgoing.arrows(domain.name, row, target, t["outcome_probability"], reward, t["outcome_observation"])
    ways = _ways(arrows, size)
    visible, action = np.divmod(choice, domain.n_actions)
    factor = t["factor"][choice]
    columns = zip(action.tolist(), visible.tolist(), factor.tolist(), value.tolist(), ways, strict=True)
    return [_Row(*each) for each in columns]


def _ways(arrows: Arrows, size: int) -> list[list[_Way]]:
    visible, value = np.divmod(arrows.target, size)
    columns = (visible, value, arrows.probability, arrows.reward, arrows.reading, arrows.same_reward())
    every = [_Way(*each) for each in zip(*(column.tolist() for column in columns), strict=True)]
    ends = [*arrows.begins.tolist(), len(every)]
    return [every[first:last] for first, last in itertools.pairwise(ends)]


def _variables(m: _Model, rewards: int) -> Iterator[str]:
    yield "<Variable>"
    for variable in [*([m.visible] if m.visible else []), *m.factors]:
        seen = "true" if variable is m.visible else "false"
        names = f"vnamePrev={quoteattr(variable.before)} vnameCurr={quoteattr(variable.after)}"
        yield f'<StateVar {names} fullyObs="{seen}">'
        yield f"<ValueEnum>{escape(' '.join(variable.values))}</ValueEnum></StateVar>"
    for name, values in [*([(_READING, m.readings)] if m.readings else []), *m.sensors]:
        yield f"<ObsVar vname={quoteattr(name)}><ValueEnum>{escape(' '.join(values))}</ValueEnum></ObsVar>"
    yield f'<ActionVar vname="{_ACTION}"><ValueEnum>{escape(" ".join(m.actions))}</ValueEnum></ActionVar>'
    yield from (f'<RewardVar vname="reward{i}"/>' for i in range(rewards))
    yield "</Variable>"


def _table(
    variable: str, parents: Sequence[str], entries: Iterable[tuple[Sequence[str], str]], func: bool = False
) -> Iterator[str]:
    """One function: entries are the values of parents and variable, and the numbers there."""
    element, numbers = ("Func", "ValueTable") if func else ("CondProb", "ProbTable")
    yield f"<{element}><Var>{escape(variable)}</Var><Parent>{escape(' '.join(parents) or 'null')}</Parent>"
    yield '<Parameter type="TBL">'
    for where, said in entries:
        yield f"<Entry><Instance>{escape(' '.join(where))}</Instance><{numbers}>{said}</{numbers}></Entry>"
    yield f"</Parameter></{element}>"


def _words(numbers: Iterable[float]) -> str:
    return " ".join(map(repr, numbers))


def _start(m: _Model) -> Iterator[str]:
    d, t = m.domain, m.domain.arrays
    begins, marginals = t["prior_visible"].tolist(), t["prior_marginals"]
    shares = np.diff(t["start_cdf"], prepend=0.0)
    if m.visible:
        chance = np.bincount(t["start_visible"], shares, d.n_visible)
        chance = np.eye(d.n_visible)[begins[0]] if len(begins) == 1 else chance
        yield from _table(m.visible.before, [], [([_EACH], _words(chance.tolist()))])
    elif len(begins) > 1:  # the end is nothing but values of the only factor
        marginals = np.bincount(np.searchsorted(begins, t["start_visible"]), shares)[None] @ marginals
    for k, factor in enumerate(m.factors):
        yield from _factor_start(m, factor, marginals[:, d.factor_offset[k] : d.factor_offset[k + 1]].tolist())


def _factor_start(m: _Model, factor: _Variable, marginals: list[list[float]]) -> Iterator[str]:
    """Its distribution at the start, by the visible value where that makes a difference.

    APPL adds up entries that overlap in this section, so there are none; a value that no episode begins in gets the
    first distribution.
    """
    if m.visible is None or all(each == marginals[0] for each in marginals):
        return _table(factor.before, [], [([_EACH], _words(marginals[0]))])
    known = dict(zip(m.domain.arrays["prior_visible"].tolist(), marginals, strict=True))
    entries = [([value, _EACH], _words(known.get(v, marginals[0]))) for v, value in enumerate(m.visible.values)]
    return _table(factor.before, [m.visible.before], entries)


def _moves(m: _Model) -> Iterator[str]:
    if m.visible:
        yield from _visible_move(m, m.visible)
    for k, factor in enumerate(m.factors):
        yield from _factor_move(m, k, factor)


def _shares(m: _Model, ways: Sequence[_Way]) -> tuple[dict[int, float], list[float]]:
    """The probability of each next visible value, and of each outcome given that: their products, exactly where
    one of the two is sure."""
    visible = [way.visible for way in ways]
    if m.visible is None or (len(set(visible)) == 1 and len(ways) > 1):
        return {visible[0]: 1.0}, [way.probability for way in ways]
    total: dict[int, float] = {}
    for way in ways:
        total[way.visible] = total.get(way.visible, 0.0) + way.probability
    return total, [way.probability / total[way.visible] for way in ways]


def _visible_move(m: _Model, visible: _Variable) -> Iterator[str]:
    cases = [(rows, [_shares(m, row.ways)[0] for row in rows]) for rows in _choices(m)]
    tied = sorted({rows[0].factor for rows, shares in cases if any(each != shares[0] for each in shares)})
    parents = [_ACTION, visible.before, *(m.factors[k].before for k in tied)]
    entries = [
        ([*_given(m, row, tied, all(each == shares[0] for each in shares)), visible.values[v]], repr(p))
        for rows, shares in cases
        for row, share in zip(rows, shares, strict=True)
        for v, p in share.items()
        if row is rows[0] or any(each != shares[0] for each in shares)
    ]
    ends = [
        ([_ANY, visible.values[v], *[_ANY] * len(tied), visible.values[v]], "1.0")
        for v in np.flatnonzero(m.domain.arrays["terminal"]).tolist()
    ]
    return _table(visible.after, parents, ends + entries)


def _choices(m: _Model) -> Iterator[list[_Row]]:
    """The rows of one action at one visible value after the other."""
    for _, rows in itertools.groupby(m.rows, key=lambda row: (row.visible, row.action)):
        yield list(rows)


def _given(m: _Model, row: _Row, factors: Sequence[int], alike: bool) -> list[str]:
    """An instance's action, visible value and values of some factors, of which the row knows its own at most."""
    values = [m.factors[k].values[row.value] if k == row.factor and not alike else _ANY for k in factors]
    return [*m.given(m.actions[row.action], m.at(row.visible)), *values]


def _factor_move(m: _Model, k: int, factor: _Variable) -> Iterator[str]:
    """It keeps its value, but where a step touches it and may not leave it so."""
    mine = [
        (rows, [_shares(m, row.ways)[1] for row in rows])
        for rows in _choices(m)
        if rows[0].factor == k and any(way.value != row.value for row in rows for way in row.ways)
    ]
    tied = any(_is_tied(m, row.ways) for rows, _ in mine for row in rows)
    parents = [_ACTION, *([m.visible.before] if m.visible else []), *([m.visible.after] if m.visible and tied else [])]
    anything = [_ANY] * len(parents)
    entries: list[tuple[list[str], str]] = [([*anything, _EACH, _EACH], "identity")]
    for rows, shares in mine:
        here = m.given(m.actions[rows[0].action], m.at(rows[0].visible))
        entries.append(([*here, *anything[len(here) :], _ANY, _ANY], "0.0"))
        for row, share in zip(rows, shares, strict=True):
            entries += [
                ([*here, *([next_] if tied else []), factor.values[row.value], factor.values[value]], repr(p))
                for next_, value, p in _given_next(m, row, share, tied)
            ]
    return _table(factor.after, [*parents, factor.before], entries)


def _is_tied(m: _Model, ways: Sequence[_Way]) -> bool:
    """Whether what the factor becomes hangs on what is visible next."""
    if m.visible is None:
        return False
    by_visible: dict[int, dict[int, float]] = {}
    for way, share in zip(ways, _shares(m, ways)[1], strict=True):
        by_visible.setdefault(way.visible, {})[way.value] = share
    return any(each != by_visible[ways[0].visible] for each in by_visible.values())


def _given_next(m: _Model, row: _Row, shares: Sequence[float], tied: bool) -> Iterator[tuple[str, int, float]]:
    """Next visible value (a wildcard where it makes no difference), next value, and its probability given that."""
    loose = not _is_tied(m, row.ways)
    for way, share in zip(row.ways, shares, strict=True):
        if not loose:
            yield m.at(way.visible), way.value, share
        elif m.visible is None or way.visible == row.ways[0].visible:
            yield _ANY, way.value, share


def _seen(m: _Model) -> Iterator[str]:
    if m.readings:
        yield from _own(m)
    for j, sensor in enumerate(m.sensors):
        yield from _sensed(m, j, sensor)


def _sensed(m: _Model, j: int, sensor: _Variable) -> Iterator[str]:
    """What a sensor reads; the first label once an episode has ended. Actions stand for themselves where it matters."""
    t, k = m.domain.arrays, m.domain.sensors[j].factor
    parents = [_ACTION, *([m.visible.after] if m.visible else []), m.factors[k].after]
    ended = np.eye(1, len(sensor.values))[0].tolist()
    entries = [([_ANY] * len(parents) + [_EACH], _words(ended))]
    rows = t["sensor_row"][:, j].reshape(-1, m.domain.n_actions)
    for v in np.flatnonzero(~t["terminal"]).tolist():
        alike = len(set(rows[v].tolist())) == 1
        for a, row in enumerate(rows[v, : 1 if alike else None].tolist()):
            here = m.given(_ANY if alike else m.actions[a], m.at(v))
            for x, value in enumerate(m.factors[k].values):
                table = t["sensor_probability"][row + x, : len(sensor.values)]
                entries.append(([*here, value, _EACH], _words(table.tolist())))
    return _table(sensor.name, parents, entries)


def _own(m: _Model) -> Iterator[str]:
    """The most frequent distribution everywhere, then the others where they belong."""
    cases = _reading_cases(m)
    tied = sorted({k for known in cases.values() for k, _ in known if len(set(known.values())) > 1})
    usual = Counter(number for known in cases.values() for number in known.values()).most_common(1)[0][0]
    table = [_words(row) for row in m.domain.arrays["observation_probability"].tolist()]
    parents = [_ACTION, *([m.visible.after] if m.visible else []), *(m.factors[k].after for k in tied)]
    entries = [([_ANY] * len(parents) + [_EACH], table[usual])]
    for (a, v), known in cases.items():
        alike = len(set(known.values())) == 1
        for (k, x), number in list(known.items())[: 1 if alike else None]:
            if number != usual:
                row = _Row(a, v, k, x, [])
                entries.append(([*_given(m, row, tied, alike), _EACH], table[number]))
    yield from _table(_READING, parents, entries)


def _reading_cases(m: _Model) -> dict[tuple[int, int], dict[tuple[int, int], int]]:
    """Of action and next visible value: the distribution by factor and its next value.

    Raises:
        HarnessError: it hangs on more than these.
    """
    cases: dict[tuple[int, int], dict[tuple[int, int], int]] = {}
    ends = m.domain.arrays["terminal"] & (m.visible is not None)
    for row in m.rows:
        for way in row.ways:
            v = way.visible if m.visible else 0
            known = cases.setdefault((row.action, v), {})
            if known.setdefault((row.factor, way.value), way.reading) != way.reading and not ends[v]:
                raise naming.readings_hang_on_more(m.domain.name, "pomdpx")
    for (a, v), known in cases.items():
        if len(set(known.values())) > 1 and len({k for k, _ in known}) > 1:
            if ends[v]:  # what is read at the end is of no use
                cases[a, v] = dict([next(iter(known.items()))])
                continue
            raise naming.readings_hang_on_more(m.domain.name, "pomdpx")
    return cases


def _rewards(m: _Model) -> Iterator[Iterator[str]]:
    """The reward as a sum of functions, one for the steps that touch nothing hidden and one for each factor."""
    written = 0
    for k in range(-1, len(m.factors)):
        rows = [row for row in m.rows if row.factor == k and any(way.reward != 0 for way in row.ways)]
        if rows or (k == len(m.factors) - 1 and not written):
            yield _reward(m, k, rows, f"reward{written}")
            written += 1


def _reward(m: _Model, k: int, rows: Sequence[_Row], name: str) -> Iterator[str]:
    own = [k] if k >= 0 else []
    after = any(not row.ways[0].pays_alike for row in rows)
    parents = [_ACTION, *([m.visible.before] if m.visible else []), *(m.factors[i].before for i in own)]
    if after:
        parents += [*([m.visible.after] if m.visible else []), *(m.factors[i].after for i in own)]
    entries = []
    for row in rows:
        for way in row.ways[: 1 if row.ways[0].pays_alike else None]:
            ends = [*([m.at(way.visible)] if m.visible else []), *(m.factors[i].values[way.value] for i in own)]
            ends = [_ANY] * len(ends) if way.pays_alike else ends
            entries.append(([*_given(m, row, own, False), *(ends if after else [])], repr(way.reward)))
    return _table(name, parents, entries or [([_ANY] * len(parents), "0.0")], func=True)
