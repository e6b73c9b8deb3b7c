"""What an environment looks like: as text, or as a picture."""

from __future__ import annotations

from typing import Any

from harness.engine.lanes import Lanes
from harness.errors import HarnessError, nearest, quoted
from harness.model.domain import Domain

MODES = ("ansi", "rgb_array")


def check_mode(mode: str | None, domain: Domain) -> None:
    """Check a render mode.

    Raises:
        HarnessError: it is unknown, or a picture is asked for of a domain without a layout.
    """
    if mode is not None and mode not in MODES:
        raise HarnessError(f"no render mode {quoted(mode)}{nearest(mode, MODES)} (known: {', '.join(MODES)})")
    if mode == "rgb_array" and domain.layout["kind"] == "none":
        raise HarnessError(f"{domain.name} has no layout to draw: render_mode 'ansi' shows its belief")


def frame(mode: str, lanes: Lanes, lane: int) -> Any:
    """A lane's state as the agent may know it: a text, or (height, width, 3) uint8."""
    batch = lanes.lane(lane)
    if mode == "ansi":
        from harness.show.replay import picture

        return picture(batch)
    from harness.show.figures import state_image

    return state_image(batch)
