"""How a domain's actions move what is visible, and where they pay: read off its tables, for edits of scripts.

A *sure move* changes the visible value, whatever is hidden, in one way only, costs no illegal-move penalty and does not
end the episode. Sequences of sure moves lead from one visible value to another by breadth-first search.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.model.domain import Domain
from harness.model.tables import Tables, compiled


class Pay(NamedTuple):
    """An action that can pay something, and the visible value where it does."""

    place: int
    action: int


class Moves:
    """The sure moves of a domain."""

    def __init__(self, domain: Domain) -> None:
        """Surveys the tables once."""
        t = domain.tables
        leads, pays = np.full(len(t.choices), -1, dtype=np.int32), np.zeros(len(t.choices), dtype=np.bool_)
        _survey(t, leads, pays)
        self.leads = leads.reshape(domain.n_visible, domain.n_actions)
        """(V, A) the visible value that surely follows; −1 where none does."""
        self.factor: NDArray[np.int16] = t.choices["factor"].reshape(self.leads.shape)
        """(V, A) the hidden factor that an action is about; −1 for none."""
        self.pays = [Pay(*divmod(int(i), domain.n_actions)) for i in np.flatnonzero(pays)]
        self.starts = t.start_visible
        self._found: dict[int, tuple[NDArray[np.int32], NDArray[np.int32]]] = {}

    def moves(self, place: int, action: int) -> bool:
        """Whether the action is a sure move there."""
        return self.leads[place, action] not in (-1, place)

    def reached(self, place: int) -> NDArray[np.intp]:
        """Visible values that sure moves lead to, the place itself included."""
        return np.flatnonzero(self._ways(place)[0] >= 0)

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
            before, by = np.full(len(self.leads), -1, dtype=np.int32), np.full(len(self.leads), -1, dtype=np.int32)
            _search(self.leads, place, before, by)
            self._found[place] = before, by
        return self._found[place]


@compiled
def _survey(t: Tables, leads: NDArray[np.int32], pays: NDArray[np.bool_]) -> None:
    """Fill in, for each choice, where it surely leads, and whether it can pay."""
    for va in range(len(t.choices)):
        row, k = t.choices[va].first_row, t.choices[va].factor
        if row >= 0:
            to, sure = -1, True
            for r in range(row, row + (1 if k < 0 else t.factor_offset[k + 1] - t.factor_offset[k])):
                sure = sure and t.rows[r].legal
                for i in range(t.rows[r].first, t.rows[r].last):
                    sure = sure and not t.outcomes[i].ends and (to < 0 or to == t.outcomes[i].visible)  # noqa: PLR1714
                    to = t.outcomes[i].visible
                    pays[va] |= t.outcomes[i].reward > 0
            if sure:
                leads[va] = to


@compiled
def _search(leads: NDArray[np.int32], place: int, before: NDArray[np.int32], by: NDArray[np.int32]) -> None:
    """Breadth first from a place: for each visible value, the one before it on a shortest way, and the action."""
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
