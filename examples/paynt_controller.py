"""PAYNT synthesises finite-state controllers; the harness says exactly what the best of them earns."""

import json
import tempfile
from pathlib import Path

from paynt.api import get_synthesizer
from paynt.parser.sketch import Sketch
from paynt.utils.timer import GlobalTimer

import harness


def main(domain="tiger", seconds=60.0, folder=None):
    """PAYNT's own figure, and the file of the controller: one node of memory first, then two, and so on."""
    folder = Path(tempfile.mkdtemp() if folder is None else folder)
    model, controller = folder / "sketch.pomdp", folder / "controller.json"
    harness.write_model(harness.load(domain), model)
    GlobalTimer.start(seconds)
    sketch, task = Sketch.load_sketch(str(model), str(folder / "none.props"))
    found = get_synthesizer(sketch, task, fsc_synthesis=True).run()
    controller.write_text(json.dumps(found.fsc.to_json(), indent=1))
    return found.value, controller


if __name__ == "__main__":
    value, controller = main()
    print(f"{controller}: {value:.4f} by PAYNT")
    print(harness.exact("tiger", f"fsc:{controller}", horizon=600))
    print(harness.compare("tiger", [f"fsc:{controller}", "solved"], horizon=600, exact=True))
