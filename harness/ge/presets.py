"""Named sets of parameters: the paper's, and the one that finds most."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from harness.errors import HarnessError, nearest, quoted

PRESETS: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {
        "paper": MappingProxyType({}),
        "best": MappingProxyType(
            {
                "generations": 150,
                "fitness": "auto",
                "penalty": 0.001,
                "free_length": 0,
                "max_init_depth": 30,
                "selection": "lexicase",
                "distinct": True,
                "crossover": "subtree",
                "mutation": "edits",
                "mutation_probability": 0.6,
                "walks": "paying",
                "local_search": 5,
                "local_search_every": 1,
                "local_search_evaluations": 100,
            }
        ),
    }
)
"""What each sets otherwise than :class:`harness.ge.parameters.Parameters`, whose defaults are those of Table 2."""


def preset(name: str) -> dict[str, Any]:
    """The parameters of a preset.

    Raises:
        HarnessError: there is no such preset.
    """
    if name not in PRESETS:
        raise HarnessError(f"no preset {quoted(name)}{nearest(name, PRESETS)} (known: {', '.join(PRESETS)})")
    return dict(PRESETS[name])
