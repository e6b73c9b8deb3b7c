"""A course of solving as a file, from which it goes on as if it had never ended."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.errors import SnapshotError
from harness.model import archive
from harness.solver import anytime
from harness.solver.points import course as points

KIND = "solver-state"
_MEND = "start anew without it"
_LARGEST = 2**40
"""Bytes; the arrays of a state may take what the solver was allowed."""
_DERIVED = {
    anytime.Course: ("domain", "branches", "floor", "floor_action"),
    points.Course: ("domain", "model", "scratch", "loss"),
}
"""What follows from the domain alone."""

Rows = Sequence[Mapping[str, float]]
Course = anytime.Course | points.Course


def save(path: Path, course: Course, history: Rows) -> None:
    """Store a course between two blocks of its work, with the rows of its history.

    Raises:
        HarnessError: the file cannot be written.
    """
    parts = dict(_parts(course))
    arrays = {name: value for name, value in parts.items() if isinstance(value, np.ndarray)}
    numbers = {name: value for name, value in parts.items() if name not in arrays}
    record = {"model_hash": course.domain.model_hash, "numbers": numbers, "history": list(history)}
    archive.write(path, KIND, record, arrays, compressed=False)


def restore(path: Path, fresh: Course) -> tuple[Course, list[dict[str, float]]]:
    """The course and the history that a file holds; ``fresh``: one that has just begun, of the same domain.

    Raises:
        SnapshotError: the file is damaged, or of another model.
    """
    record, arrays = archive.read(path, KIND, _MEND, largest=_LARGEST)
    if record.get("model_hash") != fresh.domain.model_hash:
        raise SnapshotError(f"{path}: the state of solving another model than {fresh.domain.name}; {_MEND}")
    numbers, history = record.get("numbers"), record.get("history")
    if not isinstance(numbers, dict) or not isinstance(history, list) or not _fits(fresh, numbers, arrays):
        raise SnapshotError(f"{path}: this is no state that this version of the solver can go on from; {_MEND}")
    changed: dict[str, Any] = {}
    for name in _names(fresh):
        value = getattr(fresh, name)
        if hasattr(value, "_fields"):
            changed[name] = type(value)(*(arrays[f"{name}.{part}"] for part in value._fields))
        else:
            changed[name] = arrays[name] if isinstance(value, np.ndarray) else numbers[name]
    return replace(fresh, **changed), history


def _names(course: Course) -> list[str]:
    return [field.name for field in fields(course) if field.name not in _DERIVED[type(course)]]


def _parts(course: Course) -> Iterator[tuple[str, Any]]:
    """All that a course holds, by names with a dot where it lies in a tuple."""
    for name in _names(course):
        value = getattr(course, name)
        if hasattr(value, "_fields"):
            yield from ((f"{name}.{part}", array) for part, array in value._asdict().items())
        else:
            yield name, value


def _fits(fresh: Course, numbers: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> bool:
    """Whether names and types are those of a course."""
    for name, value in _parts(fresh):
        if isinstance(value, np.ndarray):
            if name not in arrays or (arrays[name].dtype, arrays[name].ndim) != (value.dtype, value.ndim):
                return False
        elif not isinstance(numbers.get(name), (bool, int, float)):
            return False
    return len(numbers) + len(arrays) == len(list(_parts(fresh)))
