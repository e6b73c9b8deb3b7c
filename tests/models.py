"""Small domains as arrays, written here without Julia, and the value of one by brute force over all histories."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np

from harness.model import domain as domains


class Builder:
    """Collects rows of a factored domain in the order of ``julia/src/tables.jl``."""

    def __init__(self, sizes, n_actions, n_observations):
        self.sizes, self.n_actions, self.n_observations = sizes, n_actions, n_observations
        self.first_row, self.factor, self.row_outcomes = [], [], [0]
        self.outcomes, self.readings = [], []
        self.sensors, self.sensor_rows, self.sensed = (
            [],
            [],
            [],
        )  # (name, factor, labels); rows by choice; distributions

    def choice(self, factor, rows):
        """``rows``: for each value of the factor a list of (visible, value, probability, reading, reward)."""
        self.first_row.append(len(self.row_outcomes) - 1)
        self.factor.append(factor)
        for row in rows:
            self.outcomes += row
            self.row_outcomes.append(len(self.outcomes))

    def end(self):
        self.first_row += [-1] * self.n_actions
        self.factor += [-1] * self.n_actions

    def reading(self, probabilities):
        probabilities = [float(p) for p in probabilities]
        if probabilities not in self.readings:
            self.readings.append(probabilities)
        return self.readings.index(probabilities)

    def sense(self, readings):
        """For one more choice, in their order: for each sensor its distributions, one a value of its factor; None for
        a terminal visible value."""
        most = max(len(labels) for _, _, labels in self.sensors)
        rows = []
        for j in range(len(self.sensors)):
            rows.append(-1 if readings is None else len(self.sensed))
            for p in [] if readings is None else readings[j]:
                self.sensed.append([*map(float, p)] + [0.0] * (most - len(p)))
        self.sensor_rows.append(rows)

    def domain(self, name, discount, terminal, start, prior):
        columns = list(zip(*self.outcomes, strict=True))
        probability = np.array(columns[2])
        cdf = np.concatenate([np.cumsum(probability[a:b]) for a, b in itertools.pairwise(self.row_outcomes)])
        starts = list(itertools.product(*(range(n) for n in self.sizes)))
        weights = [np.prod([prior[k][x] for k, x in enumerate(values)]) for values in starts]
        kept = [i for i, weight in enumerate(weights) if weight > 0]
        readings = np.array(self.readings)
        arrays = {
            "first_row": self.first_row,
            "factor": self.factor,
            "terminal": terminal,
            "legal": [True] * (len(self.row_outcomes) - 1),
            "row_outcomes": self.row_outcomes,
            "outcome_visible": columns[0],
            "outcome_value": columns[1],
            "outcome_probability": probability,
            "outcome_cdf": cdf,
            "outcome_observation": columns[3],
            "outcome_reward": [columns[4]],
            "observation_probability": readings,
            "observation_cdf": np.cumsum(readings, axis=1),
            "start_visible": [start] * len(kept),
            "start_values": np.array([starts[i] for i in kept]).reshape(len(kept), len(self.sizes)),
            "start_cdf": np.cumsum([weights[i] for i in kept]),
            "start_observation": [-1] * len(kept),
            "prior_visible": [start],
            "prior_marginals": [[p for factor in prior for p in factor]],
            "prior_factor": [-1],
            "prior_observation": [[-1] * max(self.sizes, default=1)],
            "visible_values": np.arange(len(terminal)).reshape(-1, 1),
        }
        record = {
            "name": name,
            "version": 1,
            "title": name,
            "discount": discount,
            "states": len(terminal) * int(np.prod(self.sizes)),
            "actions": [f"a{i}()" for i in range(self.n_actions)],
            "observations": [f"o{i}" for i in range(self.n_observations)],
            "visible": ["v"],
            "factors": [f"x{k}" for k in range(len(self.sizes))],
            "factor_labels": [[str(x) for x in range(n)] for n in self.sizes],
            "features": [[f"x{k}", k, n - 1] for k, n in enumerate(self.sizes)],
            "shapings": ["none"],
            "layout": {"kind": "none"},
            "provenance": {"versions": {}},
        }
        if self.sensors:
            probability = np.array(self.sensed)
            arrays |= {"sensor_row": self.sensor_rows, "sensor_probability": probability}
            arrays["sensor_cdf"] = np.cumsum(probability, axis=1)
            record["sensors"] = self.sensors
            own = [[f"o{i}"] if self.n_observations > 1 else [] for i in range(self.n_observations)]
            of_sensors = list(itertools.product(*(labels for _, _, labels in self.sensors)))
            record["observations"] = [" ".join([*o, *labels]) for o in own for labels in of_sensors]
        return domains.from_export(record, {name: np.asarray(array) for name, array in arrays.items()})


def walk_and_sample(b, n, number, rocks, cell, reading, illegal):
    """The first five actions of RockSample in a cell: up, right, down, left, sample; the exit comes after all cells."""
    (x, y), v = cell, number[cell]
    for dx, dy in ((0, 1), (1, 0), (0, -1), (-1, 0)):
        if x + dx == n:
            b.choice(-1, [[(len(number), 0, 1.0, reading, 10.0)]])
        elif (x + dx, y + dy) in number:
            b.choice(-1, [[(number[x + dx, y + dy], 0, 1.0, reading, 0.0)]])
        else:
            b.choice(-1, [[(v, 0, 1.0, reading, illegal)]])
    if cell in rocks:
        b.choice(rocks.index(cell), [[(v, 0, 1.0, reading, -10.0)], [(v, 0, 1.0, reading, 10.0)]])
    else:
        b.choice(-1, [[(v, 0, 1.0, reading, 0.0)]])


def rocksample(n, rocks, start, discount=0.95, d0=20.0, illegal=-100.0):
    """RockSample(n, k) by SPEC's rules: 0-based rocks (column, row), actions up right down left sample check…"""
    k = len(rocks)
    b = Builder([2] * k, 5 + k, 3)
    none = b.reading([1, 0, 0])
    cells = [(x, y) for x in range(n) for y in range(n)]
    number = {cell: i for i, cell in enumerate(cells)}
    exit_ = len(cells)
    for x, y in cells:
        v = number[x, y]
        walk_and_sample(b, n, number, rocks, (x, y), none, illegal)
        for i, (rx, ry) in enumerate(rocks):
            right = 0.5 + 0.5 * 2.0 ** (-np.hypot(x - rx, y - ry) / d0)
            good, bad = b.reading([0, right, 1 - right]), b.reading([0, 1 - right, right])
            b.choice(i, [[(v, 0, 1.0, bad, 0.0)], [(v, 1, 1.0, good, 0.0)]])
    b.end()
    return b.domain(f"rocksample-{n}x{k}", discount, [False] * exit_ + [True], number[start], [[0.5, 0.5]] * k)


def field_vision(n, rocks, start, discount=0.95, d0=20.0, illegal=-100.0):
    """RockSample(n, k) as above, but without checks: every step reads all rocks, from where it has led to."""
    k = len(rocks)
    b = Builder([2] * k, 5, 1)
    b.sensors = [[str(i + 1), i, ["good", "bad"]] for i in range(k)]
    nothing = b.reading([1])
    cells = [(x, y) for y in range(n) for x in range(n)]
    number = {cell: i for i, cell in enumerate(cells)}
    exit_ = len(cells)
    for x, y in cells:
        walk_and_sample(b, n, number, rocks, (x, y), nothing, illegal)
        right = [0.5 + 0.5 * 2.0 ** (-np.hypot(x - rx, y - ry) / d0) for rx, ry in rocks]
        for _ in range(5):
            b.sense([[[1 - p, p], [p, 1 - p]] for p in right])
    b.end()
    for _ in range(5):
        b.sense(None)
    made = b.domain(f"fieldvision-{n}x{k}", discount, [False] * exit_ + [True], number[start], [[0.5, 0.5]] * k)
    places = np.array([[x + 1, y + 1] for x, y in cells] + [[0, 0]], dtype=np.int16)
    layout = {"kind": "rocksample", "rows": n, "columns": n, "exit_column": n + 1, "rows_grow": "up"}
    return dataclasses.replace(
        made,
        actions=("up()", "right()", "down()", "left()", "sample()"),
        visible_names=("x", "y"),
        features=tuple((f"belief({i + 1})", i, 1) for i in range(k)),
        arrays={**made.arrays, "visible_values": places},
        layout={**layout, "rocks": [[x + 1, y + 1] for x, y in rocks], "half_efficiency_distance": d0},
    )


def tiger():
    """Cassandra's Tiger: listen, open left, open right; γ = 0.95."""
    b = Builder([2], 3, 2)
    left, right, nothing = b.reading([0.85, 0.15]), b.reading([0.15, 0.85]), b.reading([0.5, 0.5])
    b.choice(0, [[(0, 0, 1.0, left, -1.0)], [(0, 1, 1.0, right, -1.0)]])
    for door in (0, 1):
        paid = [-100.0 if tiger == door else 10.0 for tiger in (0, 1)]
        b.choice(0, [[(0, 0, 0.5, nothing, paid[t]), (0, 1, 0.5, nothing, paid[t])] for t in (0, 1)])
    return b.domain("tiger", 0.95, [False], 0, [[0.5, 0.5]])


def random_domain(rng, sizes, n_visible, n_actions, n_observations, discount, sensors=()):
    """Anything that the tables can say: random moves, factors that change, readings that are never sure; an end.

    ``sensors``: factor and number of labels of each thing that is read unasked.
    """
    b = Builder(sizes, n_actions, n_observations)
    b.sensors = [[f"{j}", k, [f"l{i}" for i in range(n)]] for j, (k, n) in enumerate(sensors)]
    readings = [b.reading(rng.dirichlet(np.ones(n_observations))) for _ in range(4)]
    for _ in range(n_visible):
        for _ in range(n_actions):
            factor = int(rng.integers(-1, len(sizes)))
            rows = []
            for _ in range(1 if factor < 0 else sizes[factor]):
                ways = int(rng.integers(1, 4))
                share = rng.dirichlet(np.ones(ways))
                values = [0] * ways if factor < 0 else rng.integers(0, sizes[factor], ways)
                visible, drawn = rng.integers(0, n_visible + 1, ways), rng.choice(readings, ways)
                paid = rng.normal(0, 1, ways).round(2)
                rows.append(
                    [
                        (int(visible[i]), int(values[i]), float(share[i]), int(drawn[i]), float(paid[i]))
                        for i in range(ways)
                    ]
                )
            b.choice(factor, rows)
    b.end()
    for v in range(n_visible + 1) if sensors else ():
        for _ in range(n_actions):
            b.sense(None if v == n_visible else [rng.dirichlet(np.ones(n), sizes[k]) for k, n in sensors])
    prior = [rng.dirichlet(np.ones(n)).tolist() for n in sizes]
    return b.domain("random", discount, [False] * n_visible + [True], 0, prior)


def brute_force(domain, depth):
    """The best expected discounted reward of ``depth`` steps, by recursion over all actions and readings.

    The belief is a dictionary over (visible, all factors' values): nothing of how the solver sees it.
    """
    t = domain.arrays
    starts = np.diff(t["start_cdf"], prepend=0)
    belief = {
        (int(v), tuple(map(int, values))): p
        for v, values, p in zip(t["start_visible"], t["start_values"], starts, strict=True)
    }
    return _best(domain, belief, depth)


def earned_by(domain, v, marginals, actions):
    """The visible values after these actions with their probabilities, and the discounted reward on the way."""
    t, total = domain.arrays, 0.0
    split = np.split(marginals, domain.factor_offset[1:-1])
    belief = {
        (v, hidden): float(np.prod([m[x] for m, x in zip(split, hidden, strict=True)]))
        for hidden in itertools.product(*map(range, domain.factor_sizes))
    }
    for step, a in enumerate(actions):
        after = {}
        for (v, hidden), p in belief.items():
            k, row = t["factor"][v * domain.n_actions + a], t["first_row"][v * domain.n_actions + a]
            row += 0 if k < 0 else hidden[k]
            for j in range(t["row_outcomes"][row], t["row_outcomes"][row + 1]):
                q, vp = p * t["outcome_probability"][j], int(t["outcome_visible"][j])
                total += domain.discount**step * q * t["outcome_reward"][0][j]
                if not t["terminal"][vp]:
                    new = hidden if k < 0 else (*hidden[:k], int(t["outcome_value"][j]), *hidden[k + 1 :])
                    after[vp, new] = after.get((vp, new), 0.0) + q
        belief = after
    seen = {}
    for (v, _), p in belief.items():
        seen[v] = seen.get(v, 0.0) + p
    return seen, total


def _best(d, belief, depth):
    if depth == 0 or not belief:
        return 0.0
    t, values = d.arrays, []
    for a in range(d.n_actions):
        total, after = 0.0, {}
        for (v, hidden), p in belief.items():
            k, row = t["factor"][v * d.n_actions + a], t["first_row"][v * d.n_actions + a]
            row += 0 if k < 0 else hidden[k]
            for j in range(t["row_outcomes"][row], t["row_outcomes"][row + 1]):
                q = p * t["outcome_probability"][j]
                total += q * t["outcome_reward"][0][j]
                vp = int(t["outcome_visible"][j])
                if not t["terminal"][vp]:
                    new = hidden if k < 0 else (*hidden[:k], int(t["outcome_value"][j]), *hidden[k + 1 :])
                    for o, z in observed(d, a, j, new):
                        if z > 0:
                            branch = after.setdefault((vp, o), {})
                            branch[vp, new] = branch.get((vp, new), 0.0) + q * z
        values.append(total + d.discount * sum(_best(d, branch, depth - 1) for branch in after.values()))
    return max(values)


def observed(d, a, j, hidden):
    """All that may be observed after outcome ``j`` of action ``a`` led to the ``hidden`` values: what, how likely.

    What the step tells and what each sensor reads, one after the other.
    """
    t = d.arrays
    ways = list(enumerate(t["observation_probability"][t["outcome_observation"][j]]))
    for i, sensor in enumerate(d.sensors):
        row = t["sensor_row"][t["outcome_visible"][j] * d.n_actions + a, i]
        labels = [1.0] if row < 0 else t["sensor_probability"][row + hidden[sensor.factor]]
        ways = [(o * len(sensor.labels) + label, p * q) for o, p in ways for label, q in enumerate(labels)]
    return ways
