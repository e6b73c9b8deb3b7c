"""What a step of a reproduction works with: the folder, the sizes, the workers."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from matplotlib.figure import Figure

from harness import registry
from harness.reproduction import paper
from harness.reproduction.sizes import Sizes
from harness.sealed import Sealed
from harness.show import drawing

_DOMAINS = (paper.ROCKSAMPLE, paper.BORDERCROSS)


@dataclass(frozen=True)
class Folder(Sealed):
    """A reproduction's folder, and what it is told."""

    sizes: Sizes
    engine: str
    workers: int
    progress: bool

    def begin(self) -> None:
        """Make the folder, or find that it is of a reproduction of the same sizes.

        Raises:
            HarnessError: it holds something else, or cannot be written.
        """
        self.begin_with(
            {"sizes": asdict(self.sizes), "models": {name: registry.load(name).model_hash for name in _DOMAINS}},
            "reproduction",
            "of other sizes or of other models of the domains, or a damaged one; give or leave out --quick as you did "
            "then",
        )

    def draw(self, name: str, figure: Figure) -> None:
        """Write a figure."""
        drawing.save(figure, self.path / name)
