"""POMDP benchmark harness: evolved, heuristic and solved policies on domains defined once, in Julia.

    import harness
    domain = harness.load("rocksample-7x8")
    table = harness.compare(domain)                                  # the baseline table, a pandas DataFrame
    result = harness.evaluate(domain, "belief:0.84", episodes=1000)  # every return of one policy

Importing this package starts no Julia and loads nothing, not even of Python's own (Ctrl-C in that moment would be a
traceback of the command's); names are imported when first used.
"""

TYPE_CHECKING = False  # type checkers take it for true
__version__ = "0.1.0"

if TYPE_CHECKING:
    from typing import Any

    from harness.benchmark.suite import Suite, suite
    from harness.bridge import from_model
    from harness.engine.batch import Batch
    from harness.errors import HarnessError, JuliaError, PolicyError, SnapshotError
    from harness.expectation.forward import exact
    from harness.expectation.smooth.forward import Smooth, smooth
    from harness.expectation.sums import Exact, Interval
    from harness.formats import from_arrays, write_model
    from harness.ge.defaults import grammar
    from harness.ge.evaluator import Evaluator
    from harness.ge.runs import evolve, resume
    from harness.ge.simplifying import simplify
    from harness.model.agents import local_view
    from harness.model.domain import Domain
    from harness.play.cluster import cluster
    from harness.play.conformance import ConformanceError, check_domain, check_policy
    from harness.play.driven import Driven
    from harness.play.evaluation import Evaluation, Score, evaluate
    from harness.policy import Policy
    from harness.policy.agent import AgentPolicy, LogitsPolicy
    from harness.policy.controller import Controller
    from harness.policy.team import TeamPolicy
    from harness.registry import load, names
    from harness.regression.checking import check_scores, update_scores
    from harness.report import write_report
    from harness.reproduction import reproduce
    from harness.score.aggregation import aggregate, coverage
    from harness.score.comparison import compare
    from harness.score.literature import literature
    from harness.score.rendering import render
    from harness.show.figures import compare_figure, draw_beliefs, draw_episode, draw_layout
    from harness.show.replay import replay
    from harness.solver.solving import solve
    from harness.tuning import Tunable, sweep, tune
    from harness.tuning.figures import sweep_figure

__all__ = [
    "AgentPolicy",
    "Batch",
    "ConformanceError",
    "Controller",
    "Domain",
    "Driven",
    "Evaluation",
    "Evaluator",
    "Exact",
    "HarnessError",
    "Interval",
    "JuliaError",
    "LogitsPolicy",
    "Policy",
    "PolicyError",
    "Score",
    "Smooth",
    "SnapshotError",
    "Suite",
    "TeamPolicy",
    "Tunable",
    "aggregate",
    "check_domain",
    "check_policy",
    "check_scores",
    "cluster",
    "compare",
    "compare_figure",
    "coverage",
    "draw_beliefs",
    "draw_episode",
    "draw_layout",
    "evaluate",
    "evolve",
    "exact",
    "from_arrays",
    "from_model",
    "grammar",
    "literature",
    "load",
    "local_view",
    "names",
    "render",
    "replay",
    "reproduce",
    "resume",
    "simplify",
    "smooth",
    "solve",
    "suite",
    "sweep",
    "sweep_figure",
    "tune",
    "update_scores",
    "write_model",
    "write_report",
]

_HOME = {
    "AgentPolicy": "policy.agent",
    "Batch": "engine.batch",
    "ConformanceError": "play.conformance",
    "Controller": "policy.controller",
    "Domain": "model.domain",
    "Driven": "play.driven",
    "Evaluation": "play.evaluation",
    "Evaluator": "ge.evaluator",
    "Exact": "expectation.sums",
    "HarnessError": "errors",
    "Interval": "expectation.sums",
    "JuliaError": "errors",
    "LogitsPolicy": "policy.agent",
    "Policy": "policy",
    "PolicyError": "errors",
    "Score": "play.evaluation",
    "Smooth": "expectation.smooth.forward",
    "SnapshotError": "errors",
    "Suite": "benchmark.suite",
    "TeamPolicy": "policy.team",
    "Tunable": "tuning",
    "aggregate": "score.aggregation",
    "check_domain": "play.conformance",
    "check_policy": "play.conformance",
    "check_scores": "regression.checking",
    "cluster": "play.cluster",
    "compare": "score.comparison",
    "compare_figure": "show.figures",
    "coverage": "score.aggregation",
    "draw_beliefs": "show.figures",
    "draw_episode": "show.figures",
    "draw_layout": "show.figures",
    "evaluate": "play.evaluation",
    "evolve": "ge.runs",
    "exact": "expectation.forward",
    "from_arrays": "formats",
    "from_model": "bridge",
    "grammar": "ge.defaults",
    "literature": "score.literature",
    "load": "registry",
    "local_view": "model.agents",
    "names": "registry",
    "render": "score.rendering",
    "replay": "show.replay",
    "reproduce": "reproduction",
    "resume": "ge.runs",
    "simplify": "ge.simplifying",
    "smooth": "expectation.smooth.forward",
    "solve": "solver.solving",
    "suite": "benchmark.suite",
    "update_scores": "regression.checking",
    "sweep": "tuning",
    "sweep_figure": "tuning.figures",
    "tune": "tuning",
    "write_model": "formats",
    "write_report": "report",
}


if not TYPE_CHECKING:  # a type checker shall tell that a name is misspelt

    def __getattr__(name: str) -> "Any":
        import importlib

        if name not in _HOME:
            raise AttributeError(f"module 'harness' has no attribute '{name}'")
        value = getattr(importlib.import_module(f"harness.{_HOME[name]}"), name)
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
