"""What ``progress=`` means everywhere: True shows a bar on a terminal, a function is told, False is silence."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tqdm.auto import tqdm

Progress = bool | Callable[[int], object]
"""True, False, or a function that is called with the number of units finished since its last call."""


class Bar(tqdm):
    """A progress bar that is shown, told to a function, or neither."""

    def __init__(self, progress: Progress, total: int | None = None, **options: Any) -> None:
        """``options``: of tqdm."""
        self._tell = progress if callable(progress) else None
        # disable=None: show it on a terminal only
        super().__init__(total=total, disable=None if progress is True else True, **{"leave": False, **options})

    def update(self, n: float | None = 1) -> bool | None:
        """Count ``n`` more."""
        if self._tell is not None:
            self._tell(int(n or 0))
        if self.disable:
            self.n += n or 0  # which tqdm leaves alone then
        return super().update(n)
