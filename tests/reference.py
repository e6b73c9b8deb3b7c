"""Slow, plain Python versions of domains and heuristics, written from the rules and independent of the package.

They take the same uniform numbers as the engines, by the rule of the engine contract: inverse CDF in index order, the
state first, then the observation from what is left of the number.
"""

from __future__ import annotations

import itertools
import math

ROCKS = [(3, 1), (1, 2), (4, 2), (7, 4), (3, 5), (4, 5), (6, 6), (2, 7)]
DIRECTIONS = {"up": (0, 1), "right": (1, 0), "down": (0, -1), "left": (-1, 0)}
ACTIONS = ["up()", "right()", "down()", "left()", "sample()"] + [f"check({i})" for i in range(1, 9)]


def accuracy(cell, rock):
    return 0.5 + 0.5 * 2 ** (-math.dist(cell, rock) / 20)


class RockSample:
    """RockSample(7, 8) by the rules of the paper."""

    names = ACTIONS

    def __init__(self, u):
        # 256 equally likely configurations; the first rock is the most significant bit of their index.
        configuration = min(int(u * 256), 255)
        self.good = [bool(configuration >> (7 - i) & 1) for i in range(8)]
        self.cell = (1, 4)
        self.done = False
        self.reading = "none"

    def step(self, name, u):
        """Reward of the named action."""
        if self.done:
            return 0.0
        self.reading = "none"
        verb, _, rest = name.partition("(")
        if verb in DIRECTIONS:
            x, y = self.cell[0] + DIRECTIONS[verb][0], self.cell[1] + DIRECTIONS[verb][1]
            if x == 8:
                self.done = True
                return 10.0
            if not (1 <= x <= 7 and 1 <= y <= 7):
                return -100.0
            self.cell = (x, y)
            return 0.0
        if verb == "sample":
            if self.cell not in ROCKS:
                return 0.0
            rock = ROCKS.index(self.cell)
            reward = 10.0 if self.good[rock] else -10.0
            self.good[rock] = False
            return reward
        rock = int(rest[:-1]) - 1
        right = accuracy(self.cell, ROCKS[rock])
        good = right if self.good[rock] else 1 - right  # P(reading "good"); "good" comes before "bad" in index order
        self.reading = "good" if u < good else "bad"
        return 0.0


class BorderCross:
    """BorderCross by the rules of the paper; rows grow downward."""

    names = [f"{d}({r})" for r in (1, 2) for d in ("up", "right", "down", "left")] + ["cooperate()"]

    def __init__(self, u, hidden=False):
        starts = [(row, column) for row in range(1, 8) for column in range(1, 4)] if hidden else [(7, 3)]
        cumulative = list(itertools.accumulate([1 / len(starts)] * len(starts)))
        i = next((i for i, c in enumerate(cumulative) if u < c), len(starts) - 1)
        below = cumulative[i - 1] if i else 0.0
        self.robots = {1: (4, 1), 2: starts[i]}
        self.done = False
        self.reading = self.read((u - below) / (cumulative[i] - below))

    def read(self, u):
        return next((k for k, c in enumerate(itertools.accumulate(self.readings())) if u < c), 9)

    def readings(self):
        return reading_probabilities(math.dist(self.robots[1], self.robots[2]))

    def step(self, name, u):
        if self.done:
            return 0.0
        reward = 0.0
        if name == "cooperate()":
            if self.robots[1] == self.robots[2] and self.robots[1][1] == 6:
                self.done = True
                self.robots = {1: (0, 0), 2: (0, 0)}
                reward = 500.0
        else:
            verb, robot = name.rstrip(")").split("(")
            robot = int(robot)
            dx, dy = DIRECTIONS[verb]
            row, column = self.robots[robot][0] - dy, self.robots[robot][1] + dx
            if 1 <= row <= 7 and 1 <= column <= 6:
                self.robots[robot] = (row, column)
            else:
                reward = -100.0
        self.reading = self.read(u)
        return reward


def reading_probabilities(d):
    """P(round(d + |N(0, σ)|) = k), capped at 9, by the error function."""
    sigma = 1 - 2 ** (-d / 20)

    def below(x):
        if x <= 0:
            return 0.0
        return math.erf(x / (sigma * math.sqrt(2))) if sigma else 1.0

    edges = [below(k - 0.5 - d) for k in range(10)] + [1.0]
    return [b - a for a, b in itertools.pairwise(edges)]


class BruteForceBelief:
    """P(rock i is good) by Bayes' rule over all 256 configurations, none of them thought independent."""

    def __init__(self):
        self.weights = dict.fromkeys(itertools.product((False, True), repeat=8), 1 / 256)

    def update(self, cell, name, reading):
        if name == "sample()" and cell in ROCKS:
            rock = ROCKS.index(cell)
            after: dict[tuple[bool, ...], float] = {}
            for bits, weight in self.weights.items():
                emptied = (*bits[:rock], False, *bits[rock + 1 :])
                after[emptied] = after.get(emptied, 0.0) + weight
            self.weights = after
        elif name.startswith("check"):
            rock = int(name[6:-1]) - 1
            right = accuracy(cell, ROCKS[rock])
            for bits in self.weights:
                self.weights[bits] *= right if bits[rock] == (reading == "good") else 1 - right
            total = sum(self.weights.values())
            self.weights = {bits: weight / total for bits, weight in self.weights.items()}

    def features(self):
        return [sum(w for bits, w in self.weights.items() if bits[i]) for i in range(8)]


def _walk(cell, rock):
    (x, y), (rx, ry) = cell, rock
    if x != rx:
        return "right()" if x < rx else "left()"
    if y != ry:
        return "up()" if y < ry else "down()"
    return "sample()"


def _manhattan(a, b):
    return abs(a[0] - b[0]) + abs(a[1] - b[1])


class AccuracyHeuristic:
    """Algorithm 2."""

    def __init__(self, threshold):
        self.threshold = threshold
        self.gone = set()  # sampled or rejected
        self.good = set()
        self.asked = None

    def act(self, cell, reading, beliefs):
        if self.asked is not None:
            (self.good if reading == "good" else self.gone).add(self.asked)
            self.asked = None
        candidates = [i for i in range(8) if i not in self.gone and accuracy(cell, ROCKS[i]) > self.threshold]
        if not candidates:
            return "right()"
        rock = min(candidates, key=lambda i: (_manhattan(cell, ROCKS[i]), i))
        if rock not in self.good:
            self.asked = rock
            return f"check({rock + 1})"
        action = _walk(cell, ROCKS[rock])
        if action == "sample()":
            self.gone.add(rock)
        return action


class BeliefHeuristic:
    """Algorithm 3."""

    def __init__(self, threshold):
        self.threshold = threshold
        self.sampled = set()

    def act(self, cell, reading, beliefs):
        candidates = [i for i in range(8) if i not in self.sampled and not beliefs[i] < 1 - self.threshold]
        if not candidates:
            return "right()"
        rock = min(candidates, key=lambda i: (_manhattan(cell, ROCKS[i]), i))
        if not beliefs[rock] > self.threshold:
            return f"check({rock + 1})"
        action = _walk(cell, ROCKS[rock])
        if action == "sample()":
            self.sampled.add(rock)
        return action


class ThresholdsHeuristic:
    """The five thresholds, rock by rock in words."""

    def __init__(self, accept, reject, ahead, aside, wait):
        self.accept, self.reject, self.ahead, self.aside, self.wait = accept, reject, ahead, aside, wait

    def worth(self, cell, i, belief):
        to_sample = _manhattan(cell, ROCKS[i]) + 1.0
        steps = to_sample if belief >= self.accept else 1.0 + belief * to_sample  # a reading, and then perhaps the walk
        worth = belief / steps
        if ROCKS[i][0] > cell[0]:
            worth *= self.wait ** float(ROCKS[i][0] - cell[0])
        return worth

    def act(self, cell, reading, beliefs):
        rocks = [i for i in range(8) if beliefs[i] > self.reject]
        if not rocks:
            return "right()"
        rock = max(rocks, key=lambda i: (self.worth(cell, i, beliefs[i]), -i))
        if beliefs[rock] >= self.accept:
            return _walk(cell, ROCKS[rock])
        needed = self.ahead if ROCKS[rock][0] > cell[0] else self.aside
        if accuracy(cell, ROCKS[rock]) >= needed:
            return f"check({rock + 1})"
        return _walk(cell, ROCKS[rock])
