"""A policy in somebody else's simulator: here ours, step by step through `Driven`."""

from __future__ import annotations

import numpy as np
import pytest

import harness
from harness.play.evaluation import simulate
from harness.policy import make


@pytest.mark.parametrize("spec", ["belief", "ge-feedback", "random-legal"])  # one looks only, one remembers, one draws
def test_it_decides_as_in_our_own_simulator(spec, rocksample):
    driven = harness.Driven(rocksample, spec, seed=5)
    played = make(spec, rocksample)[1]
    played.uses_belief = True  # so that there is one to hand over
    seen = None
    for record in simulate(rocksample, played, "tables", 5, 0, 30, 15):
        if seen is not None:
            live = ~seen.pop("done")
            assert np.array_equal(driven.act(**seen)[live], record.actions[live])
        b = record.batch
        seen = {
            "step": b.step,
            "visible": b.visible.copy(),
            "observation": b.observation.copy(),
            "marginals": b.marginals.copy(),
            "done": b.done.copy(),
        }


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"visible": [10_000]}, "visible must be one index an episode, from 0 to"),
        ({"observation": [-2]}, "observation must be one index an episode, from -1 to"),
        ({"marginals": [[0.5]]}, r"marginals must have the shape \(1, 16\), not \(1, 1\)"),
        ({"step": 1}, "no episodes have begun"),
    ],
)
def test_what_does_not_fit_is_refused(changed, message, rocksample):
    given = {"step": 0, "visible": [0], "observation": [-1], "marginals": [[0.5] * 16]}
    with pytest.raises(harness.PolicyError, match=message):
        harness.Driven(rocksample, "belief").act(**given | changed)
