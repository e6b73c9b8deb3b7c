"""Is a domain well formed? Names, shapes, indices, probabilities and running sums, before anything uses them.

Compiled code follows the indices of the arrays without looking: one of them out of range reads, or writes, memory that
is not the array's. So a snapshot is checked when it is read, whatever its hash says; the conformance check says the
same of any other domain.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, TypeGuard

import numpy as np
from numpy.typing import NDArray

from harness.errors import quoted

if TYPE_CHECKING:
    from harness.model.domain import Domain

_TOLERANCE = 1e-9
_LONGEST_NAME = 200
LARGEST_WHOLE = 2**31 - 1
"""Of versions, numbers of states and indices."""
LARGEST_REWARD = 1e30
"""Of rewards and values, so that sums and squares of them are still numbers."""
_LARGEST_NUMBER = 1e300  # a whole number may be too long to be converted to one with a point
_LARGEST_GRID = 1000

SHAPES: dict[str, tuple[str, ...]] = {
    "visible_values": ("visible", "visible names"),
    "first_row": ("visible × actions",),
    "factor": ("visible × actions",),
    "terminal": ("visible",),
    "legal": ("rows",),
    "row_outcomes": ("rows + 1",),
    "outcome_visible": ("outcomes",),
    "outcome_value": ("outcomes",),
    "outcome_probability": ("outcomes",),
    "outcome_cdf": ("outcomes",),
    "outcome_observation": ("outcomes",),
    "outcome_reward": ("shapings", "outcomes"),
    "observation_probability": ("readings", "own observations"),
    "observation_cdf": ("readings", "own observations"),
    "start_visible": ("starts",),
    "start_values": ("starts", "factors"),
    "start_cdf": ("starts",),
    "start_observation": ("starts",),
    "prior_visible": ("priors",),
    "prior_marginals": ("priors", "marginals"),
    "prior_factor": ("priors",),
    "prior_observation": ("priors", "longest factor"),
    "sensor_row": ("visible × actions", "sensors"),
    "sensor_probability": ("sensor readings", "most labels"),
    "sensor_cdf": ("sensor readings", "most labels"),
}
"""What the axes of the arrays stand for."""


def record_breaches(record: Mapping[str, Any]) -> Iterator[str]:
    """What is wrong with the names and numbers beside the arrays, as read from a file."""
    for name, least in (("version", 0), ("states", 1)):
        if not whole(record.get(name), least, LARGEST_WHOLE):
            yield f"{name} is {quoted(record.get(name))}, not a whole number of {least} … {LARGEST_WHOLE}"
    discount = record.get("discount")
    if not isinstance(discount, (int, float)) or isinstance(discount, bool) or abs(discount) > _LARGEST_NUMBER:
        yield f"discount is {quoted(discount)}, not a number"
    for name in ("name", "title"):
        if not is_name(record.get(name)):
            yield f"{name} is {quoted(record.get(name))}, not a printable text"
    for name in ("actions", "observations", "visible", "factors", "shapings"):
        if not _are_names(record.get(name)):
            yield f"{name} is no list of printable texts of {_LONGEST_NAME} characters at most"
    labels = record.get("factor_labels")
    if not isinstance(labels, list) or not all(_are_names(each) and each for each in labels):
        yield "factor_labels is no list of lists of printable texts"
    features = record.get("features")
    if not isinstance(features, list) or not all(_is_feature(each) for each in features):
        yield "features is no list of [name, factor, value]"
    sensors = record.get("sensors", [])
    if not isinstance(sensors, list) or not all(_is_sensor(each) for each in sensors):
        yield "sensors is no list of [name, factor, labels]"
    agents = record.get("agents", [])
    if not isinstance(agents, list) or not all(_is_agent(each) for each in agents):
        yield "agents is no list of [name, actions, observations]"
    for name in ("layout", "provenance"):
        if not isinstance(record.get(name), dict):
            yield f"{name} is no table of names and values"


def whole(value: Any, least: int, most: int) -> bool:
    """Whether a value is a whole number within limits; true and false are none."""
    return isinstance(value, int) and not isinstance(value, bool) and least <= value <= most


def is_name(value: Any) -> bool:
    """Whether a value is a text that can be shown: printable, on one line, of 200 characters at most."""
    return isinstance(value, str) and value.isprintable() and len(value) <= _LONGEST_NAME


def _are_names(value: Any) -> bool:
    return isinstance(value, list) and all(map(is_name, value))


def _is_feature(value: Any) -> bool:
    if not isinstance(value, list) or len(value) != 3:
        return False
    return is_name(value[0]) and all(whole(index, 0, LARGEST_WHOLE) for index in value[1:])


def _is_sensor(value: Any) -> bool:
    if not isinstance(value, list) or len(value) != 3 or not is_name(value[0]):
        return False
    return whole(value[1], 0, LARGEST_WHOLE) and _are_names(value[2]) and len(value[2]) > 1


def _is_agent(value: Any) -> bool:
    if not isinstance(value, list) or len(value) != 3 or not is_name(value[0]):
        return False
    return all(_are_names(names) and names for names in value[1:])


def type_breaches(arrays: Mapping[str, NDArray[Any]], types: Mapping[str, Any]) -> Iterator[str]:
    """Arrays that are missing, or hold numbers of another type: casting these could change what they say."""
    for name, kind in types.items():
        if name not in arrays:
            yield f"the array {name} is missing"
        elif arrays[name].dtype != kind:
            yield f"{name} is of type {arrays[name].dtype}, needed is {np.dtype(kind)}"


def breaches(domain: Domain) -> Iterator[str]:
    """What is wrong with a domain, each with the array and the place; of the arrays, only as far as it can be said."""
    yield from _name_breaches(domain)
    for check in (_shape_breaches, _factor_breaches, _row_breaches, _index_breaches, _content_breaches):
        with np.errstate(invalid="ignore", over="ignore"):  # what is no number is found by what it is not
            found = list(check(domain))
        yield from found
        if found:  # what comes next would only fail in stranger ways
            return


def _name_breaches(d: Domain) -> Iterator[str]:
    if not 0 < d.discount <= 1:
        yield f"the discount {d.discount} is not in (0, 1]"
    if d.shapings[:1] != ("none",):
        yield "the first shaping is not 'none', the true reward"
    if len(d.factor_labels) != len(d.factors):
        yield f"there are {len(d.factors)} factors and labels of {len(d.factor_labels)}"
    for what, names in (
        ("action", d.actions),
        ("observation", d.observations),
        ("feature", [f[0] for f in d.features]),
        ("shaping", d.shapings),
        ("sensor", [sensor.name for sensor in d.sensors]),
        ("agent", [agent.name for agent in d.agents]),
    ):
        if len(set(names)) != len(names):
            yield f"two {what}s share a name"
    yield from _sensor_breaches(d)
    yield from _agent_breaches(d)
    yield from _layout_breaches(d)


def _sensor_breaches(d: Domain) -> Iterator[str]:
    """Their names; programs say ``3 == "good"`` of an action ``check(3)`` and of a sensor ``3``."""
    for sensor in d.sensors:
        if len(set(sensor.labels)) != len(sensor.labels):
            yield f"two labels of the sensor {quoted(sensor.name)} share a name"
        if f"check({sensor.name})" in d.actions:
            yield f"the sensor {quoted(sensor.name)} and the action check({sensor.name}) are told apart by nothing"
    if d.sensors and d.n_observations % d.n_labels:
        yield f"{d.n_observations} observations are no combinations of the {d.n_labels} of the sensors' labels"


def _agent_breaches(d: Domain) -> Iterator[str]:
    """Actions and observations are the combinations of the agents' own."""
    for agent in d.agents:
        if any(len(set(names)) != len(names) for names in (agent.actions, agent.observations)):
            yield f"two actions or two observations of the agent {quoted(agent.name)} share a name"
    if d.agents and d.sensors:
        yield "there are agents and sensors, but what a sensor reads is read by no agent"
    for what, count, parts in (
        ("actions", d.n_actions, [len(agent.actions) for agent in d.agents]),
        ("observations", d.n_observations, [len(agent.observations) for agent in d.agents]),
    ):
        if d.agents and count != math.prod(parts):
            yield f"{count} {what} are not the {math.prod(parts)} combinations of the agents' own"


_COLUMNS: dict[str, tuple[str, ...]] = {"rocksample": ("exit_column",), "grid": ()}
"""Which columns a layout names by its kind; any other names an exit and a wall."""


def _layout_breaches(d: Domain) -> Iterator[str]:
    """The layout has what policies and drawings of its kind take from it."""
    layout, kind = d.layout, d.layout.get("kind")
    if not isinstance(kind, str):
        yield "the layout says no kind"
    elif kind != "none":
        for name in ("rows", "columns", *_COLUMNS.get(kind, ("exit_column", "wall_column"))):
            if not whole(layout.get(name), 1, _LARGEST_GRID):
                yield f"the layout's {name} is {quoted(layout.get(name))}, not a number of 1 … {_LARGEST_GRID}"
        if layout.get("rows_grow") not in ("up", "down"):
            yield "the layout's rows_grow is neither 'up' nor 'down'"
        if kind == "rocksample":
            yield from _rock_breaches(d)
        elif kind == "grid":
            yield from _map_breaches(d)


def _are_cells(value: Any) -> TypeGuard[list[list[int]]]:
    return isinstance(value, list) and all(
        isinstance(cell, list) and len(cell) == 2 and all(whole(x, 1, _LARGEST_GRID) for x in cell) for cell in value
    )


def _map_breaches(d: Domain) -> Iterator[str]:
    """Walls, signs and the cells that values of a hidden factor stand for."""
    signs, cells = d.layout.get("signs"), d.layout.get("hidden_cells")
    if not _are_cells(d.layout.get("walls")):
        yield "the layout's walls are no list of cells [x, y]"
    if not isinstance(signs, list) or not all(
        isinstance(sign, list) and sign and is_name(sign[0]) and len(sign[0]) == 1 and _are_cells([sign[1:]])
        for sign in signs
    ):
        yield "the layout's signs are no list of [character, x, y]"
    if not _are_cells(cells) or (cells and [len(cells)] != [len(labels) for labels in d.factor_labels]):
        yield "the layout's hidden_cells are no list of cells [x, y], one for every value of the one hidden factor"


def _rock_breaches(d: Domain) -> Iterator[str]:
    rocks, reach = d.layout.get("rocks"), d.layout.get("half_efficiency_distance")
    if not _are_cells(rocks):
        yield "the layout's rocks are no list of cells [x, y]"
        return
    if not isinstance(reach, (int, float)) or not 0 < reach < 1e9:
        yield f"the layout's half_efficiency_distance is {quoted(reach)}, not a number above 0"
    if not isinstance(best := d.layout.get("best_accuracy", 1.0), (int, float)) or not 0.5 <= best <= 1:
        yield f"the layout's best_accuracy is {quoted(best)}, not a number of 0.5 … 1"
    moves = ("up()", "right()", "down()", "left()", "sample()")
    checks = d.actions[d.actions.index("check(1)") :][: len(rocks)] if "check(1)" in d.actions else ()
    numbers = [str(i + 1) for i in range(len(rocks))]
    seen = [(sensor.name, sensor.factor) for sensor in d.sensors] == list(zip(numbers, itertools.count()))
    asked = not d.sensors and checks == tuple(f"check({i})" for i in numbers)
    if not rocks or not set(moves) <= set(d.actions) or not (asked or seen):
        yield "the actions are not those of RockSample, one check for every rock in order, or else a sensor for each"
    readings = [sensor.labels for sensor in d.sensors] or [d.observations]
    if len(d.features) != len(rocks) or d.visible_names != ("x", "y") or any("good" not in r for r in readings):
        yield "features, visible names or observations are not those of RockSample"


def _shape_breaches(d: Domain) -> Iterator[str]:
    first = {name: (*array.shape, 0)[0] for name, array in d.arrays.items()}
    rows, longest = first["legal"], max(d.factor_sizes, default=1)
    sizes = {
        "visible": first["visible_values"], "visible names": len(d.visible_names),
        "visible × actions": first["visible_values"] * d.n_actions, "rows": rows, "rows + 1": rows + 1,
        "outcomes": first["outcome_visible"], "shapings": len(d.shapings), "observations": d.n_observations,
        "readings": first["observation_probability"], "starts": first["start_cdf"], "priors": first["prior_visible"],
        "factors": len(d.factors), "marginals": d.n_marginals, "longest factor": longest,
        "own observations": d.n_observations // d.n_labels, "sensors": len(d.sensors),
        "sensor readings": first.get("sensor_probability", 0),
        "most labels": max((len(sensor.labels) for sensor in d.sensors), default=0),
    }  # fmt: skip
    for name in ("visible", "visible × actions", "rows", "outcomes", "observations", "readings", "starts", "priors"):
        if sizes[name] < 1:
            yield f"there are no {name}"
    for name in d.arrays:
        axes = SHAPES[name]
        expected = tuple(sizes[axis] for axis in axes)
        if d.arrays[name].shape != expected:
            yield f"{name} has the shape {d.arrays[name].shape}, needed is {expected}: {', '.join(axes)}"


def _factor_breaches(d: Domain) -> Iterator[str]:
    yield from outside("factor", d.arrays["factor"], -1, len(d.factors))


def _row_breaches(d: Domain) -> Iterator[str]:
    """Choices lead to rows that exist, rows to outcomes that exist."""
    t = d.arrays
    ends = t["row_outcomes"].astype(np.int64)  # whose differences are not cut to 32 bits
    bad = np.diff(ends) < 1
    if bad.any():
        yield f"row {bad.argmax()} has no outcome (row_outcomes does not rise there)"
    if ends[0] != 0 or ends[-1] != len(t["outcome_visible"]):
        yield f"row_outcomes runs from {ends[0]} to {ends[-1]}, not from 0 to the {len(t['outcome_visible'])} outcomes"
    terminal = np.repeat(t["terminal"], d.n_actions)
    bad = terminal & (t["first_row"] != -1)
    if bad.any():
        yield f"a terminal visible value has rows (first_row[{bad.argmax()}] is not -1)"
    last = len(t["legal"]) - _sizes(d)[t["factor"]]
    bad = ~terminal & ((t["first_row"] < 0) | (t["first_row"] > last))
    if bad.any():
        yield f"first_row[{bad.argmax()}] is {t['first_row'][bad.argmax()]}, which points outside the rows"


def _sizes(d: Domain) -> NDArray[np.int64]:
    """(K + 1,) values of each factor; the last entry serves factor −1, which has one row."""
    return np.array([*d.factor_sizes, 1])


def _index_breaches(d: Domain) -> Iterator[str]:
    t, readings = d.arrays, len(d.arrays["observation_probability"])
    limits = np.repeat(_row_limits(d), np.diff(t["row_outcomes"]))
    yield from outside("outcome_visible", t["outcome_visible"], 0, d.n_visible)
    yield from outside("outcome_value", t["outcome_value"], 0, limits)
    yield from outside("outcome_observation", t["outcome_observation"], 0, readings)
    yield from outside("start_visible", t["start_visible"], 0, d.n_visible)
    yield from outside("start_values", t["start_values"], 0, _sizes(d)[:-1])
    yield from outside("start_observation", t["start_observation"], -1, readings)
    yield from outside("prior_visible", t["prior_visible"], 0, d.n_visible)
    yield from outside("prior_factor", t["prior_factor"], -1, len(d.factors))
    yield from outside("prior_observation", t["prior_observation"], -1, readings)
    yield from _sensor_row_breaches(d)
    for name, k, x in d.features:
        if not 0 <= k < len(d.factors) or not 0 <= x < d.factor_sizes[k]:
            yield f"the feature {quoted(name)} names a factor or value that does not exist"
            break


def _sensor_row_breaches(d: Domain) -> Iterator[str]:
    """Each sensor reads a factor that exists, wherever an episode goes on."""
    if not d.sensors:
        return
    t = d.arrays
    for sensor in d.sensors:
        if sensor.factor >= len(d.factors):
            yield f"the sensor {quoted(sensor.name)} reads factor {sensor.factor}, which does not exist"
            return
    terminal = np.repeat(t["terminal"], d.n_actions)[:, None]
    after = len(t["sensor_probability"]) + 1 - np.array([d.factor_sizes[sensor.factor] for sensor in d.sensors])
    yield from outside("sensor_row", t["sensor_row"], np.where(terminal, -1, 0), np.where(terminal, 0, after))
    if (t["start_observation"] >= 0).any():
        yield "something is read before the first step, which no domain with sensors has"


def _row_limits(d: Domain) -> NDArray[np.int64]:
    """(rows,) number of values of the factor that a row's outcomes may change, the least where choices share it."""
    t, sizes = d.arrays, _sizes(d)
    limits = np.full(len(t["legal"]), sizes.max())
    live = t["first_row"] >= 0
    first, size = t["first_row"][live], sizes[t["factor"][live]]
    for n in np.unique(size)[::-1]:
        begun = np.zeros(len(limits) + 1, dtype=np.int64)
        np.add.at(begun, first[size == n], 1)
        np.add.at(begun, first[size == n] + n, -1)
        limits[begun.cumsum()[:-1] > 0] = n
    return limits


def _content_breaches(d: Domain) -> Iterator[str]:
    yield from _outcome_breaches(d)
    yield from _distribution_breaches("observation", d.arrays["observation_probability"], d.arrays["observation_cdf"])
    if d.sensors:
        yield from _distribution_breaches("sensor", d.arrays["sensor_probability"], d.arrays["sensor_cdf"])
        yield from _label_breaches(d)
    yield from _start_breaches(d)
    yield from _prior_breaches(d)
    yield from _legal_breaches(d)


def _outcome_breaches(d: Domain) -> Iterator[str]:
    t = d.arrays
    probability, cdf, first = t["outcome_probability"], t["outcome_cdf"], t["row_outcomes"][:-1]
    yield from faulty("outcome_probability", ~(probability > 0), "is not above 0")
    totals = np.add.reduceat(probability, first)
    bad = ~(np.abs(totals - 1) <= _TOLERANCE)
    if bad.any():
        yield f"the outcomes of row {bad.argmax()} do not sum to 1"
    below = np.concatenate([[0.0], cdf[:-1]])
    below[first] = 0.0
    wrong = ~(np.abs(cdf - below - probability) <= _TOLERANCE) | (cdf < below)
    yield from faulty("outcome_cdf", wrong, "is not the running sum of the row's probabilities")
    rewards = t["outcome_reward"]
    yield from faulty("outcome_reward", ~(np.abs(rewards) <= LARGEST_REWARD), "is not a finite number")


def _distribution_breaches(name: str, probability: NDArray[np.float64], cdf: NDArray[np.float64]) -> Iterator[str]:
    yield from faulty(f"{name}_probability", ~(probability >= 0), "is negative")
    bad = ~(np.abs(probability.sum(axis=1) - 1) <= _TOLERANCE)
    yield from faulty(f"{name}_probability", bad, "does not sum to 1")
    below = np.concatenate([np.zeros((len(cdf), 1)), cdf[:, :-1]], axis=1)
    wrong = ~(np.abs(cdf - below - probability) <= _TOLERANCE) | (cdf < below)
    wrong |= (probability == 0) & (cdf != below)  # what is impossible would be drawn
    yield from faulty(f"{name}_cdf", wrong, f"is not the running sum of {name}_probability")


def _label_breaches(d: Domain) -> Iterator[str]:
    """No sensor with few labels has a chance of more."""
    for j, sensor in enumerate(d.sensors):
        first = d.arrays["sensor_row"][:, j]
        for x in range(d.factor_sizes[sensor.factor]):
            rows = d.arrays["sensor_probability"][first[first >= 0] + x]
            if (rows[:, len(sensor.labels) :] > 0).any():
                yield f"the sensor {quoted(sensor.name)} may read a label beyond its {len(sensor.labels)}"
                return


def _start_breaches(d: Domain) -> Iterator[str]:
    cdf = d.arrays["start_cdf"]
    yield from faulty("start_cdf", ~(np.diff(cdf, prepend=0.0) > 0), "does not rise to 1")
    if not abs(cdf[-1] - 1) <= _TOLERANCE:
        yield f"start_cdf does not rise to 1 but to {cdf[-1]:g}"
    unknown = ~np.isin(d.arrays["start_visible"], d.arrays["prior_visible"])
    yield from faulty("start_visible", unknown, "is not in prior_visible")
    unknown = ~np.isin(d.arrays["prior_visible"], d.arrays["start_visible"])
    yield from faulty("prior_visible", unknown, "is not in start_visible")


def _prior_breaches(d: Domain) -> Iterator[str]:
    t, prior = d.arrays, d.arrays["prior_marginals"]
    yield from faulty("prior_marginals", ~(prior >= 0), "is negative")
    for k, name in enumerate(d.factors):
        total = prior[:, d.factor_offset[k] : d.factor_offset[k + 1]].sum(axis=1)
        if not (np.abs(total - 1) <= _TOLERANCE).all():
            yield f"the prior of {quoted(name)} is not a distribution"
            break
    read = np.isin(t["prior_visible"], t["start_visible"][t["start_observation"] >= 0])
    for i in np.flatnonzero(read & (t["prior_factor"] >= 0)):
        k = t["prior_factor"][i]
        first, last = d.factor_offset[k], d.factor_offset[k + 1]
        if ((prior[i, first:last] > 0) & (t["prior_observation"][i, : last - first] < 0)).any():
            yield f"prior_observation[{i}] has no reading for a value that is possible"
            break


def _legal_breaches(d: Domain) -> Iterator[str]:
    """Policies that play legal actions only find one in every state."""
    t = d.arrays
    size, first = _sizes(d)[t["factor"]], t["first_row"]
    live = first >= 0
    legal = np.concatenate([[0], np.cumsum(t["legal"])])
    always = np.zeros(len(first), dtype=np.bool_)  # choices that are legal whatever is hidden
    always[live] = legal[first[live] + size[live]] - legal[first[live]] == size[live]
    surely = always.reshape(d.n_visible, -1).any(axis=1)
    for v in np.flatnonzero(~surely & ~t["terminal"]).tolist():
        if not _legal_by_factor(d, v):
            yield f"no action is legal at visible value {v}, or none for some hidden value"
            return


def _legal_by_factor(d: Domain, v: int) -> bool:
    """Whether the actions that hang on one factor have a legal one among them for each of its values."""
    some: dict[int, NDArray[np.bool_]] = {}
    for va in range(v * d.n_actions, (v + 1) * d.n_actions):
        k, row = int(d.arrays["factor"][va]), d.arrays["first_row"][va]
        if k >= 0:
            rows = d.arrays["legal"][row : row + d.factor_sizes[k]]
            some[k] = some[k] | rows if k in some else rows
    return any(values.all() for values in some.values())


def outside(
    name: str, array: NDArray[Any], low: int | NDArray[np.int64], high: int | NDArray[np.int64]
) -> Iterator[str]:
    """The first index of an array that is not in ``low … high − 1``."""
    bad = (array < low) | (array >= high)
    if bad.any():
        place = np.unravel_index(bad.argmax(), bad.shape)
        least, most = (int(np.broadcast_to(limit, bad.shape)[place]) for limit in (low, high))
        yield f"{_entry(name, place)} is {array[place]}, which leaves the range {least} … {most - 1}"


def faulty(name: str, where: NDArray[np.bool_], what: str) -> Iterator[str]:
    """The first entry of an array that a mask finds at fault, and what is wrong with it."""
    if where.any():
        yield f"{_entry(name, np.unravel_index(where.argmax(), where.shape))} {what}"


def _entry(name: str, place: tuple[Any, ...]) -> str:
    return f"{name}[{', '.join(map(str, place))}]"
