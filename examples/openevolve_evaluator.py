"""The evaluation function of a search that a language model guides, by OpenEvolve's interface.

    openevolve-run initial_program.txt examples/openevolve_evaluator.py --config config.yaml

Candidates are files in the language of the programs; `#` begins a comment there, so the marks of the evolved block may
stand in them. Set `file_suffix: .txt` and `language: text` in the configuration. No model is called here.
"""

from pathlib import Path

import numpy as np

import harness

EVALUATE = harness.Evaluator("rocksample-7x8", episodes=2000, workers=1)
WORST = -100.0  # for what is no program: a search wants finite numbers


def evaluate(program_path: str) -> dict:
    """``combined_score`` is what is maximised; ``error`` is the sentence that the model should read."""
    text = Path(program_path).read_text(encoding="utf-8")
    fault = EVALUATE.fault(text)
    if fault is not None:
        return {"combined_score": WORST, "valid": 0.0, "error": fault}
    returns = EVALUATE.returns([text])[0]
    sem = float(returns.std(ddof=1) / np.sqrt(len(returns)))
    return {
        "combined_score": float(returns.mean()),
        "sem": sem,
        "worst_tenth": float(np.quantile(returns, 0.1)),
        "valid": 1.0,
    }
