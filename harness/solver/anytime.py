"""The solver's course of work: a grid, trials on it, a finer grid, more trials, until the bounds are as close as asked.

The work is cut by its amount, not by the clock: about as much is spent on trials as the grid cost, then the grid is
given four times the cells. So the bounds after so many blocks are the same on any machine.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from harness import host
from harness.errors import HarnessError
from harness.model.domain import Domain
from harness.solver import grid, refining, search
from harness.solver import levels as level_sets
from harness.solver.backups import Backups, backups
from harness.solver.branches import Branches, branches_of
from harness.solver.floor import robust
from harness.solver.grid import Above
from harness.solver.levels import Levels
from harness.solver.lookahead import Model
from harness.solver.search import N_EDGES, N_NODES, Graph

_FIRST_CELLS = 10_000
_GROWTH = 4
_SWEEPS = 40
_STILL = 0.05
"""A grid is swept until the start's value seems to fall by no more than this share of the bounds' gap."""
_SETTLING = 0.3
"""Share of the last sweep's fall that the next one is taken to have, before two sweeps of a grid have shown it."""
_VALUES_A_NODE = 400
"""Values of the grid that are backed up in the time of a node of the search; measured, roughly."""
_ABREAST = 1000
"""Cells of a wave from which on several cores share it."""
_BLOCK = 50_000_000  # values of the grid in one call: a second or two, so that Ctrl-C and the time limit are heard


@dataclass(frozen=True)
class Course:
    """Where the work stands; what follows depends on nothing else."""

    domain: Domain
    branches: Branches
    floor: NDArray[np.float64]
    """(V,) what can be had whatever is hidden"""
    floor_action: NDArray[np.int32]
    """(V,) by which action"""
    levels: Levels
    backups: Backups
    """Of these levels"""
    value: NDArray[np.float32]
    """(cells, V) the grid"""
    graph: Graph
    waves: list[NDArray[np.int32]]
    """Its cells in the order of a sweep"""
    stage: int
    """Grids so far"""
    sweeps: int
    """Of this grid"""
    wave: int
    """The next one of the sweep under way"""
    before: float
    """The grid's value at the start before that sweep"""
    fall: float
    """of that value in the last sweep"""
    settling: float
    """Falls of two sweeps in a row, the later over the earlier one"""
    still: bool
    """Whether this grid has come to a standstill"""
    quota: int
    """Nodes that trials may still make before the grid is refined"""

    @property
    def lower(self) -> float:
        """Lower bound of the optimal value at the start."""
        return float(self.graph.lower[0])

    @property
    def upper(self) -> float:
        """Upper bound of the optimal value at the start."""
        return float(self.graph.upper[0])

    @property
    def memory(self) -> int:
        """Bytes of the grid and the graph."""
        return int(self.value.nbytes + 4 * self.levels.cells + sum(array.nbytes for array in self.graph))

    @property
    def grid_value(self) -> float:
        """The grid's upper bound at the start."""
        return float(grid.grid_value(self.model.above, self.branches.factor_offset, *root(self.graph)))

    @property
    def model(self) -> Model:
        """As the search takes it."""
        above = Above(self.value, self.levels.offset, self.levels.point, self.levels.stride)
        span = np.abs(self.branches.reward).max() / (1.0 - self.branches.discount)
        widest = int(np.diff(self.branches.factor_offset).max(initial=0))
        relative = 2.0 * (widest * 2.0**-43 + 100 * 2.0**-52)  # rounded posteriors; sums of some ten terms
        return Model(self.branches, above, self.floor, relative * (1.0 + float(span)))


def begin(domain: Domain) -> Course:
    """The coarsest grid: all factors observed.

    Raises:
        HarnessError: the domain cannot be solved this way.
    """
    if not 0 < domain.discount < 1:
        raise HarnessError(f"{domain.name} has discount {domain.discount:g}; solving needs one between 0 and 1")
    b = branches_of(domain)
    floor, action = robust(b, 1e-9)
    levels = level_sets.make(level_sets.corners(domain.factor_sizes))
    terminal = domain.arrays["terminal"]
    value = np.empty((levels.cells, domain.n_visible), dtype=np.float32)
    value[:] = np.nextafter(np.float32(max(0.0, b.reward.max()) / (1.0 - b.discount)), np.float32(np.inf))
    value[:, terminal] = 0.0
    graph = search.empty(b, 20_000, 100_000)
    tables = backups(b, levels, floor)
    course = Course(
        domain, b, floor, action, levels, tables, value, graph, grid.waves(levels), 0, 0, 0, np.inf, 0.0, _SETTLING, False, 0
    )  # fmt: skip
    starts = roots(domain)
    if len(starts) > 1 or (domain.arrays["prior_factor"] >= 0).any():  # a first reading splits the start, too
        raise HarnessError(
            f"{domain.name} has several starts, by visible value or first reading; this solver takes one"
        )
    search.node_of(graph, course.model, *starts[0])
    return course


def root(graph: Graph) -> tuple[int, NDArray[np.float64]]:
    """Visible value and belief (N,) of the start."""
    return int(graph.visible[0]), graph.belief[0]


def roots(domain: Domain) -> list[tuple[int, NDArray[np.float64]]]:
    """Visible values and beliefs (N,) that episodes can start in."""
    return [
        (int(v), row.copy())
        for v, row in zip(domain.arrays["prior_visible"], domain.arrays["prior_marginals"], strict=True)
    ]


def blocks(course: Course, gap: float, memory: int) -> Iterator[Course]:
    """Work on until the bounds are within ``gap`` or nothing is left to do; yields after about a second's work.

    ``memory``: bytes that the grid and the graph may take.
    """
    while course.upper - course.lower > gap:
        if not course.still:
            course = _swept(course)
        elif course.quota > 0:
            made = course.graph.counts[N_NODES]
            course = _tried(course, gap, memory)
            if course.graph.counts[N_NODES] == made and course.upper - course.lower > gap:
                course = replace(course, quota=0)
        else:
            finer = _finer(course, memory)
            if finer is None:
                before = _progress(course)
                course = _tried(course, gap, memory)
                if _progress(course) == before:  # as close as rounding lets them come
                    return
            else:
                course = finer
        yield course


def _progress(course: Course) -> tuple[float, float, int]:
    return course.lower, course.upper, int(course.graph.counts[N_NODES])


def _swept(course: Course) -> Course:
    """Some waves of a sweep of the grid, on all cores."""
    wave, done = course.wave, 0
    if wave == 0:
        course = replace(course, before=course.grid_value)
    with ThreadPoolExecutor(host.cores()) as pool:
        while wave < len(course.waves) and done < _BLOCK:
            cells = course.waves[wave]
            parts = np.array_split(cells, host.cores()) if len(cells) > _ABREAST else [cells]
            list(pool.map(partial(_sweep, course), parts))
            wave, done = wave + 1, done + len(cells) * course.value.shape[1]
    return replace(course, wave=wave) if wave < len(course.waves) else _after_sweep(course)


def _sweep(course: Course, cells: NDArray[np.int32]) -> None:
    levels, b = course.levels, course.branches
    grid.sweep(course.value, course.backups, cells, levels.offset, levels.stride, course.floor, b.discount)


def _after_sweep(course: Course) -> Course:
    now, sweeps = course.grid_value, course.sweeps + 1
    fall = course.before - now
    settling = min(0.99, fall / course.fall) if sweeps > 1 and course.fall > 0 else course.settling
    enough = _STILL * (min(now, course.upper) - course.lower)
    still = fall * settling / (1 - settling) <= enough or sweeps >= _SWEEPS
    if still:
        course = replace(course, graph=search.pruned(course.graph, course.branches))
        search.refresh(course.graph, course.model)
    quota = max(2000, course.value.size * sweeps // _VALUES_A_NODE) if still and course.stage > 0 else 0
    return replace(course, sweeps=sweeps, wave=0, fall=fall, settling=settling, still=still, quota=quota)


def _tried(course: Course, gap: float, memory: int) -> Course:
    """Trials for about a second, with more room if they need it."""
    graph = course.graph
    made = int(graph.counts[N_NODES])
    search.trials(graph, course.model, gap, 200)
    room = min(len(graph.visible) - graph.counts[N_NODES], len(graph.child) - graph.counts[N_EDGES])
    if room < search.room(course.branches):
        larger = search.grown(graph, course.branches, 2 * len(graph.visible), 2 * len(graph.child))
        if course.value.nbytes + sum(array.nbytes for array in larger) <= memory:
            graph = larger
    return replace(course, graph=graph, quota=course.quota - (int(graph.counts[N_NODES]) - made))


def _finer(course: Course, memory: int) -> Course | None:
    """The same with more levels; None where there is no room for them, or nothing calls for them."""
    old, n_visible = course.levels, course.branches.n_visible
    affordable = (memory - course.memory) // (2 * 4 * n_visible)  # the old grid stays while the new one is filled
    most = min(max(_FIRST_CELLS, _GROWTH * old.cells), affordable)
    if course.stage == 0:
        points = refining.with_priors(course.branches, course.model.above, course.graph, most)
    else:
        points = refining.refined(course.graph, course.model, old, most, course.stage)
    levels = level_sets.make(points)
    if levels.cells == old.cells and course.stage > 0:
        return None
    value = grid.finer(course.value, old, levels, course.domain.factor_sizes)
    return replace(
        course,
        levels=levels,
        backups=backups(course.branches, levels, course.floor),
        value=value,
        waves=grid.waves(levels),
        stage=course.stage + 1,
        sweeps=0,
        still=False,
    )
