"""The hall of fame of a run: of every length the program of the highest mean return that any generation has seen.

A program enters where all that are as short, or shorter, have earned less. The figures are those that selection saw, on
a generation's own episodes, so lucky ones; in the end the hall is judged once more (:mod:`harness.ge.front`). The file
is ``hall.json``: all that ever entered, in order.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from harness.ge.entries import Entries, Kind
from harness.program import Program

KIND = Kind("hall.json", "programs by length", {"generation": int, "length": int, "mean": float})


class Hall(Entries):
    """The file in a run's folder, or in memory, and what will be in it."""

    def __init__(self, folder: Path | None, generations: int) -> None:
        """Those that entered in the first so many generations.

        Raises:
            HarnessError: the file is damaged.
        """
        super().__init__(KIND, folder, generations)
        self._best: list[float] = []  # of programs of at most so many statements
        for each in self.found:
            self._raise(each["length"], each["mean"])

    def see(self, generation: int, programs: Sequence[Program], means: NDArray[np.float64]) -> None:
        """Programs that a generation has judged, and their mean returns."""
        for i in np.argsort(-means, kind="stable").tolist():
            program, mean = programs[i], float(means[i])
            if mean > self._raise(program.length):
                self._raise(program.length, mean)
                lines = program.text.splitlines()
                self.found.append({"generation": generation, "length": program.length, "mean": mean, "program": lines})

    def _raise(self, length: int, mean: float = -math.inf) -> float:
        """What is known to be had by at most so many statements, with one more program of that length."""
        while len(self._best) <= length:
            self._best.append(self._best[-1] if self._best else -math.inf)
        for longer in range(length, len(self._best)):
            if mean <= self._best[longer]:
                break
            self._best[longer] = mean
        return self._best[length]

    def programs(self) -> list[str]:
        """Texts of those that no later one of the same length has surpassed, the shortest first."""
        latest = {each["length"]: each["program"] for each in self.found}
        return ["\n".join(latest[length]) + "\n" for length in sorted(latest)]
