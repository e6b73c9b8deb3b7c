"""The solver's course of work: a whole grid, coarse; then runs on a sparse finer one and trials, in turns.

The work is cut by its amount, not by the clock, and about as much is spent on trials as on the grid. So the bounds
after so many blocks are the same on any machine and any number of cores.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from harness import host
from harness.model.domain import Domain
from harness.solver import exploring, grid, plans, refining, search, sweeping
from harness.solver import levels as level_sets
from harness.solver.backups import Backups, backups
from harness.solver.branches import Branches, branches_of
from harness.solver.floor import robust
from harness.solver.grid import Above
from harness.solver.levels import Levels
from harness.solver.lookahead import Model
from harness.solver.plans import Plans
from harness.solver.search import N_EDGES, N_NODES, Graph

_FIRST_CELLS = 10_000
_GROWTH = 32
"""Cells of a whole grid over those of the one before, at most"""
_WHOLE = 0.6
"""Share of the memory that a whole grid may take, its copy for the search with it"""
_WHOLE_VALUES = 5_000_000
"""Values of a whole grid whose levels go by the beliefs met, at most: a few seconds for a sweep"""
_SWEEPS = 40
_STILL = 0.02
"""Sweeps of a grid end when the start's value seems to fall by no more than this share of the bounds' gap."""
_QUIET = 0.005
"""Runs on a sparse grid end, for this turn, when a call does not lower the value by more than this share of the gap."""
_STUCK = 0.0005
"""The same, for the sparse grid to be given more levels."""
_SETTLING = 0.3
"""Share of the last sweep's fall that the next one is taken to have, before two sweeps of a grid have shown it."""
_INNER = (3, 7, 15, 31)
"""Levels of a factor beside the certain ones, at most, in the sparse grids that follow each other."""
_BATCHES = 32
"""Batches of runs in one call"""
_NODES_A_BATCH = 250
"""Nodes of the search that take the time of a batch of runs; measured, roughly."""
_FIRST_NODES = 2000
_FALLEN = 0.1
"""Share of the bounds' gap by which the grid must fall for the search to begin anew."""
_ROWS = 50_000
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
    base: Levels
    """Of the last whole grid"""
    above: Above
    plans: Plans
    """For the search's leaves"""
    graph: Graph
    stage: int = 0
    """Grids before this one"""
    refined: int = 0
    """How often levels were chosen by the beliefs met"""
    sweeps: int = 0
    """Of this grid, if it is whole; calls for runs in this turn, if not"""
    wave: int = 0
    """The next one of the sweep under way"""
    batches: int = 0
    """Of runs, so far"""
    before: float = np.inf
    """The grid's value at the start before the work under way"""
    fall: float = 0.0
    """of that value in the last sweep"""
    settling: float = _SETTLING
    """Falls of two sweeps in a row, the later over the earlier one"""
    pruned: float = np.inf
    """The grid's value at the start when the search began anew"""
    still: bool = False
    """Whether this grid has come to a standstill, for now"""
    quota: int = 0
    """Nodes that trials may still make before it is the grid's turn"""

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
        """Bytes of the grid, the plans and the graph."""
        order = 0 if self.sparse else 4 * self.levels.cells
        return order + sum(array.nbytes for array in (*self.above, *self.plans, *self.graph))

    @property
    def sparse(self) -> bool:
        """Whether the grid is a sparse one."""
        return len(self.above.table) > 0

    @property
    def rows(self) -> int:
        """Cells that the grid holds."""
        return int(self.above.used[0]) if self.sparse else self.levels.cells

    @property
    def grid_value(self) -> float:
        """The grid's upper bound at the start."""
        return float(grid.start_value(self.above, self.branches.factor_offset, *root(self.graph)))

    @property
    def model(self) -> Model:
        """As the search takes it."""
        span = np.abs(self.branches.reward).max() / (1.0 - self.branches.discount)
        widest = int(np.diff(self.branches.factor_offset).max(initial=0))
        relative = 2.0 * (widest * 2.0**-43 + 100 * 2.0**-52)  # rounded posteriors; sums of some ten terms
        return Model(self.branches, self.above, self.floor, relative * (1.0 + float(span)), self.plans)


@dataclass(frozen=True)
class _Tools:
    """What follows from a course's levels."""

    backups: Backups
    waves: list[NDArray[np.int32]]


def begin(domain: Domain) -> Course:
    """The coarsest grid: all factors observed. The domain has one start and a discount below 1."""
    b = branches_of(domain)
    floor, action = robust(b, 1e-9)
    levels = level_sets.make(level_sets.corners(domain.factor_sizes))
    value = np.empty((levels.cells, domain.n_visible), dtype=np.float32)
    value[:] = np.nextafter(np.float32(max(0.0, b.reward.max()) / (1.0 - b.discount)), np.float32(np.inf))
    value[:, domain.arrays["terminal"]] = 0.0
    course = Course(
        domain,
        b,
        floor,
        action,
        levels,
        levels,
        grid.whole(value, levels),
        plans.plans(value, levels.stride, domain.factor_sizes),
        search.empty(b, 20_000, 100_000),
    )
    start = domain.arrays["prior_visible"][0], domain.arrays["prior_marginals"][0].copy()
    search.node_of(course.graph, course.model, int(start[0]), start[1])
    return course


def root(graph: Graph) -> tuple[int, NDArray[np.float64]]:
    """Visible value and belief (N,) of the start."""
    return int(graph.visible[0]), graph.belief[0]


def blocks(course: Course, gap: float, memory: int) -> Iterator[Course]:
    """Work on until the bounds are within ``gap`` or nothing is left to do; yields after about a second's work.

    ``memory``: bytes that the grid and the graph may take.
    """
    tools, stood = _tools(course), None
    while course.upper - course.lower > gap:
        if not course.still:
            course = _explored(course, tools, memory) if course.sparse else _swept(course, tools)
        elif course.quota > 0:
            course = _tried(course, gap, memory)
        elif course.sparse and not _stuck(course):
            course = _once_more(course)
        else:
            finer = _finer(course, memory)
            if finer.levels is not course.levels:
                tools = _tools(finer)
            elif stood == _progress(course):
                return
            else:
                stood = _progress(course)
                finer = _once_more(finer)
            course = finer
        yield course


def _tools(course: Course) -> _Tools:
    made = backups(course.branches, course.levels, course.floor)
    waves = [] if course.sparse else sweeping.waves(course.levels)
    return _Tools(made, waves)


def _once_more(course: Course) -> Course:
    return replace(course, still=False, sweeps=0)


def _progress(course: Course) -> tuple[float, ...]:
    return course.lower, course.upper, course.grid_value, int(course.graph.counts[N_NODES]), course.rows, course.refined


def _swept(course: Course, tools: _Tools) -> Course:
    """Some waves of a sweep of the grid, on all cores."""
    wave, done = course.wave, 0
    if wave == 0:
        course = replace(course, before=course.grid_value)
    with ThreadPoolExecutor(host.cores()) as pool:
        while wave < len(tools.waves) and done < _BLOCK:
            cells = tools.waves[wave]
            parts = np.array_split(cells, host.cores()) if len(cells) > _ABREAST else [cells]
            list(pool.map(partial(_sweep, course, tools.backups), parts))
            wave, done = wave + 1, done + len(cells) * course.above.value.shape[1]
    return replace(course, wave=wave) if wave < len(tools.waves) else _after_sweep(course)


def _sweep(course: Course, tables: Backups, cells: NDArray[np.int32]) -> None:
    sweeping.sweep(course.above, tables, cells, course.floor, course.branches.discount)


def _after_sweep(course: Course) -> Course:
    now, sweeps = course.grid_value, course.sweeps + 1
    fall = course.before - now
    settling = min(0.99, fall / course.fall) if sweeps > 1 and course.fall > 0 else course.settling
    still = fall * settling / (1 - settling) <= _STILL * (now - course.lower) or sweeps >= _SWEEPS
    course = replace(course, sweeps=sweeps, wave=0, fall=fall, settling=settling)
    coarse = course.stage == 0 and course.levels.cells > 1  # a finer grid costs little and is worth more than trials
    return _at_rest(course, 0 if coarse else _FIRST_NODES) if still else course


def _at_rest(course: Course, quota: int) -> Course:
    """The grid stands still: the search's turn, with the grid's new values where they have fallen much."""
    now = course.grid_value
    if not course.sparse:
        course.above.across[:] = course.above.value.T
    if now < course.pruned - _FALLEN * max(0.0, now - course.lower):
        course = replace(course, graph=search.pruned(course.graph, course.branches), pruned=now)
        search.refresh(course.graph, course.model)
    return replace(course, still=True, quota=quota)


def _explored(course: Course, tools: _Tools, memory: int) -> Course:
    """Some batches of runs on the sparse grid, with more room if they need it."""
    course = _with_room(course, memory)
    b, before = course.branches, course.grid_value
    cells, weights = grid.cells_of(course.above, b.factor_offset, root(course.graph)[1])
    done = exploring.explore(
        course.above,
        tools.backups,
        exploring.places(tools.backups, course.levels, b.n_visible),
        course.floor,
        b.discount,
        root(course.graph)[0],
        cells,
        weights,
        course.batches,
        _BATCHES,
    )
    now, turns = course.grid_value, course.sweeps + 1
    course = replace(course, batches=course.batches + done, sweeps=turns, before=before, fall=before - now)
    if before - now > _QUIET * (now - course.lower) and done == _BATCHES:
        return course
    return _at_rest(course, _NODES_A_BATCH * max(1, done) * turns)


def _with_room(course: Course, memory: int) -> Course:
    above = course.above
    used, rows = int(above.used[0]), len(above.cell)
    if rows - used >= 2 * exploring.ROOM:
        return course
    if course.memory + 2 * (above.value.nbytes + above.table.nbytes + above.cell.nbytes) > memory:
        return course
    return replace(course, above=grid.roomier(above, 2 * rows))


def _stuck(course: Course) -> bool:
    return course.fall <= _STUCK * (course.upper - course.lower)


def _tried(course: Course, gap: float, memory: int) -> Course:
    """Trials for about a second, with more room if they need it."""
    graph = course.graph
    made = int(graph.counts[N_NODES])
    search.trials(graph, course.model, gap, 200)
    new = int(graph.counts[N_NODES]) - made
    room = min(len(graph.visible) - graph.counts[N_NODES], len(graph.child) - graph.counts[N_EDGES])
    if room < search.room(course.branches):
        if course.memory + 2 * sum(array.nbytes for array in graph) <= memory:
            graph = search.grown(graph, course.branches, 2 * len(graph.visible), 2 * len(graph.child))
        else:
            graph = search.pruned(graph, course.branches)
            search.refresh(graph, course.model)
    return replace(course, graph=graph, quota=course.quota - new if new else 0)


def _finer(course: Course, memory: int) -> Course:
    """More levels: of a whole grid while there is room for them, then of a sparse one; itself, where none are left."""
    most = int(_WHOLE * memory) // (8 * len(course.floor))
    if not course.sparse:
        bounded = min(max(_FIRST_CELLS, _GROWTH * course.levels.cells), most)
        levels = level_sets.make(refining.with_priors(course.model, course.graph, course.levels, bounded))
        if levels.cells > course.levels.cells:
            return _whole(course, levels)
    needed = 3 * _ROWS * 8 * len(course.floor)
    if course.refined == len(_INNER) or course.memory + needed > memory:
        return course
    levels = level_sets.make(refining.refined(course.model, course.graph, course.levels, _INNER[course.refined]))
    course = replace(course, refined=course.refined + 1)
    if levels.cells == course.levels.cells:
        return course
    if not course.sparse and levels.cells <= min(most, _WHOLE_VALUES // len(course.floor)):
        return _whole(course, levels)
    return _on(course, levels, _sparse(course, levels))


def _whole(course: Course, levels: Levels) -> Course:
    if course.stage == 0:  # the grid of corners, and it stands still
        known = plans.plans(course.above.value, course.levels.stride, course.domain.factor_sizes)
        course = replace(course, plans=known)
    value = grid.finer(course.above.value, course.levels, levels, course.domain.factor_sizes)
    return _on(replace(course, base=levels), levels, grid.whole(value, levels))


def _sparse(course: Course, levels: Levels) -> Above:
    sizes, old = course.domain.factor_sizes, course.above
    if not course.sparse:
        return grid.sparse(old.value, old.across, course.base, levels, sizes, _ROWS)
    above = grid.sparse(old.base, old.across, course.base, levels, sizes, len(old.cell))
    grid.carry(old, above, level_sets.places(course.levels, levels))
    return above


def _on(course: Course, levels: Levels, above: Above) -> Course:
    return replace(course, levels=levels, above=above, stage=course.stage + 1, sweeps=0, still=False)
