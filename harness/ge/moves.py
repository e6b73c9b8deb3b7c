"""How a domain's actions move what is visible, and where they pay: read off its tables, for edits of scripts.

A *place* is a visible value, or, of a domain with a single hidden factor, a whole state: there the moves may change
what is hidden. A *sure move* leads from a place to another one only, costs no illegal-move penalty and does not end
the episode. Sequences of sure moves lead from place to place by breadth-first search.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.model.domain import Domain
from harness.model.tables import Tables, compiled

_REMEMBERED = 10_000_000  # places of all the ways that are kept, 8 bytes each


class Pay(NamedTuple):
    """An action that can pay something, and the place where it does."""

    place: int
    action: int


class Moves:
    """The sure moves of a domain."""

    def __init__(self, domain: Domain) -> None:
        """Surveys the tables once."""
        t = domain.tables
        hidden = domain.factor_sizes[0] if len(domain.factors) == 1 else 1
        self.leads = np.full((domain.n_visible * hidden, domain.n_actions), -1, dtype=np.int32)
        """(P, A) the place that surely follows; −1 where none does. P places: visible value · hidden values + value."""
        pays = np.zeros(self.leads.shape, dtype=np.bool_)
        _survey(t, hidden, self.leads, pays)
        factor = t.choices["factor"].reshape(domain.n_visible, domain.n_actions)
        self.factor: NDArray[np.int16] = np.repeat(factor, hidden, axis=0)
        """(P, A) the hidden factor that an action is about; −1 for none."""
        self.pays = [Pay(int(place), int(action)) for place, action in np.argwhere(pays)]
        self.starts: list[int] = (t.start_visible * hidden + (t.start_values[:, 0] if hidden > 1 else 0)).tolist()
        self._found: dict[int, tuple[NDArray[np.int32], NDArray[np.int32]]] = {}

    def moves(self, place: int, action: int) -> bool:
        """Whether the action is a sure move there."""
        return self.leads[place, action] not in (-1, place)

    def reached(self, place: int) -> list[int]:
        """Where sure moves lead to, the place itself included."""
        return [int(v) for v in np.flatnonzero(self._ways(place)[0] >= 0)]

    def path(self, place: int, to: int) -> list[int] | None:
        """Actions of a shortest sequence of sure moves; None where there is none."""
        before, by = self._ways(place)
        if before[to] < 0:
            return None
        actions: list[int] = []
        while to != place:
            actions.append(int(by[to]))
            to = int(before[to])
        return actions[::-1]

    def _ways(self, place: int) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        if place not in self._found:
            if (len(self._found) + 1) * len(self.leads) > _REMEMBERED:
                self._found.clear()
            before, by = np.full(len(self.leads), -1, dtype=np.int32), np.full(len(self.leads), -1, dtype=np.int32)
            _search(self.leads, place, before, by)
            self._found[place] = before, by
        return self._found[place]


@compiled
def _survey(t: Tables, hidden: int, leads: NDArray[np.int32], pays: NDArray[np.bool_]) -> None:
    """Fill in, for each place and action, where it surely leads, and whether it can pay."""
    for place in range(len(leads)):
        v, x = place // hidden, place % hidden
        for a in range(t.n_actions):
            row, k = t.choices[v * t.n_actions + a].first_row, t.choices[v * t.n_actions + a].factor
            if row < 0:
                continue
            first = row + x if hidden > 1 and k >= 0 else row
            last = row + t.factor_offset[k + 1] - t.factor_offset[k] if hidden == 1 and k >= 0 else first + 1
            to, sure = -1, True
            for r in range(first, last):
                sure = sure and t.rows[r].legal
                for i in range(t.rows[r].first, t.rows[r].last):
                    after = t.outcomes[i].visible * hidden
                    if hidden > 1:
                        after += t.outcomes[i].value if k >= 0 else x
                    sure = sure and not t.outcomes[i].ends and (to < 0 or to == after)
                    to = after
                    pays[place, a] |= t.outcomes[i].reward > 0
            if sure:
                leads[place, a] = to


@compiled
def _search(leads: NDArray[np.int32], place: int, before: NDArray[np.int32], by: NDArray[np.int32]) -> None:
    """Breadth first from a place: for each other, the one before it on a shortest way, and the action."""
    queue, head, tail = np.empty(len(leads), dtype=np.int32), 0, 1
    queue[0], before[place] = place, place
    while head < tail:
        v = queue[head]
        head += 1
        for a in range(leads.shape[1]):
            to = leads[v, a]
            if to >= 0 and before[to] < 0:
                before[to], by[to] = v, a
                queue[tail] = to
                tail += 1
