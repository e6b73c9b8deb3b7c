"""Policies and solvers of POMDPs.jl as rows of a table. What needs Julia or a package of it is skipped without."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import harness
from harness import bridge, policy
from harness.play.evaluation import evaluate

SMALL_TIGER = f"""
using POMDPs, POMDPTools
include(raw"{bridge.package_folder() / "test" / "models.jl"}")
Tiger()
"""

PLANNERS = {
    "BasicPOMCP": "POMCPSolver(tree_queries = 200, c = 110.0, max_depth = 10)",
    "ARDESPOT": """
        DESPOTSolver(bounds = IndependentBounds(-2000.0, 200.0), K = 50, D = 10, max_trials = 20, T_max = Inf)""",
    "AdaOPS": """
        AdaOPSSolver(bounds = AdaOPS.IndependentBounds(-2000.0, 200.0), max_depth = 10, max_trials = 10, T_max = Inf,
                     num_b = 1000)""",
}
PAGE = (Path(__file__).parent.parent / "docs" / "julia-policies.md").read_text(encoding="utf-8")
PLANNERS_SHOWN = [text for text in re.findall(r"```julia\n(.*?)```", PAGE, re.DOTALL) if "python_policy" not in text]

OFFLINE = {
    "PointBasedValueIteration": "PBVISolver(max_iterations = 5)",
    "FIB": "FIBSolver(max_iterations = 1000, tolerance = 1e-6)",
    "NativeSARSOP": "SARSOPSolver(precision = 1e-2, verbose = false, max_time = 10.0)",
    "QMDP": "QMDPSolver(max_iterations = 1000)",
}


class TestWithoutJulia:
    def test_a_julia_file_is_a_policy_string(self):
        assert policy.names_code("planner.jl")
        assert "FILE.jl" in policy.specs(harness.load("rocksample-7x8"))

    def test_one_that_stands_in_data_is_not_run(self):
        with pytest.raises(harness.PolicyError, match=r"'planner\.jl' names a file, which would be run"):
            policy.check_from_data("planner.jl")

    @pytest.mark.parametrize("run", [harness.evaluate, harness.compare])
    def test_it_plays_on_the_engine_julia_alone(self, run, tmp_path):
        path = tmp_path / "planner.jl"
        path.write_text("1")
        with pytest.raises(harness.PolicyError, match="plays on the engine julia, not on tables"):
            run("rocksample-7x8", str(path), engine="tables")

    def test_a_missing_file_is_named(self, rocksample):
        with pytest.raises(harness.PolicyError, match=r"'nowhere\.jl': no such file"):
            policy.make("nowhere.jl", rocksample)


needs_julia = pytest.mark.skipif(not bridge.is_set_up(), reason="no Julia is set up for the harness")


def needs_package(name):
    if bridge.julia().seval("name -> Base.find_package(name) === nothing")(name):
        pytest.skip(f"the Julia package {name} is not installed")


@pytest.fixture(scope="module")
def tiger(tmp_path_factory):
    path = tmp_path_factory.mktemp("model") / "tiger.jl"
    path.write_text(SMALL_TIGER)
    return harness.load(str(path))


@pytest.fixture
def written(tmp_path):
    def write(text, name="planner.jl"):
        (tmp_path / name).write_text(text)
        return str(tmp_path / name)

    return write


def played(domain, spec, episodes, batch_size=None, seed=0, horizon=20):
    made = policy.make(spec, domain)[1]
    made.batch_size = batch_size or made.batch_size
    return evaluate(domain, made, episodes=episodes, engine="julia", horizon=horizon, seed=seed)


IN_JULIA = """(file, episodes, horizon, exact) -> begin
    m, scope = Tiger(), Module()
    solver = Base.include(scope, file)
    solver isa Pair && (solver = first(solver))
    play(k) = begin
        policy = Base.invokelatest(solve, solver, m)
        up = exact ? DiscreteUpdater(m) : Base.invokelatest(updater, policy)
        simulator = RolloutSimulator(; rng = Xoshiro(k), max_steps = horizon)
        Base.invokelatest(simulate, simulator, m, policy, up, initialstate(m))
    end
    return [play(k) for k in 1:episodes]
end"""


def in_julia(path, episodes, exact, horizon=20):
    """Discounted returns by POMDPs.jl's own simulator."""
    import juliacall

    scope = juliacall.newmodule("Reference")
    scope.seval("using PomdpHarness; using PomdpHarness: POMDPs, POMDPTools, Random")
    scope.seval("using .POMDPs, .POMDPTools, .Random")
    scope.seval(f'include(raw"{bridge.package_folder() / "test" / "models.jl"}")')
    return np.array(scope.seval(IN_JULIA)(path, episodes, horizon, exact))


def agree(a, b):
    return abs(a.mean() - b.mean()) < 4 * np.hypot(a.std() / len(a) ** 0.5, b.std() / len(b) ** 0.5)


@needs_julia
@pytest.mark.filterwarnings("default")
class TestRows:
    @pytest.mark.parametrize("package", PLANNERS)
    @pytest.mark.parametrize("exact", [False, True])
    def test_online_planners_earn_what_they_earn_in_julia(self, package, exact, tiger, written):
        """The reference is POMDPs.jl's own simulator, with the same solver and updater."""
        needs_package(package)
        pair = " => belief_updater" if exact else ""
        path = written(f"using {package}, PomdpHarness\n{PLANNERS[package]}{pair}")
        one = played(tiger, path, 100)
        assert agree(one.discounted, in_julia(path, 100, exact))
        assert np.array_equal(one.returns, played(tiger, path, 100, batch_size=7).returns)
        assert not np.array_equal(one.returns, played(tiger, path, 100, seed=1).returns)

    @pytest.mark.parametrize("package", OFFLINE)
    def test_offline_solvers_are_solved_once(self, package, tiger, written):
        needs_package(package)
        path = written(f"using {package}\n{OFFLINE[package]}")
        row = harness.compare(tiger, path, episodes=2000, horizon=60, engine="julia").iloc[0]
        assert row.details.startswith(f"{package} ")
        assert OFFLINE[package].partition("(")[0] in row.details
        assert abs(row.discounted_mean - in_julia(path, 300, True, 60).mean()) < 20

    def test_random_policies_draw_uniformly_and_alike(self, tiger, written):
        path = written("using POMDPTools\nRandomPolicy")
        one = played(tiger, path, 3000)
        expected = 20 * (-1 - 45 - 45) / 3
        assert abs(one.score.mean - expected) < 4 * one.score.sem
        assert np.array_equal(one.returns, played(tiger, path, 3000, batch_size=100).returns)

    def test_a_function_policy_is_given_the_last_reading(self, tiger, written):
        path = written("using POMDPTools\nFunctionPolicy(o -> o isa Bool ? (o ? :right : :left) : :listen)")
        # Listen once, then open by a reading that is right with 0.85; after a door is opened readings say nothing.
        one = played(tiger, path, 4000, horizon=2)
        assert abs(one.score.mean - (-1 + 0.85 * 10 - 0.15 * 100)) < 4 * one.score.sem

    def test_a_function_policy_may_ask_for_the_exact_belief(self, tiger, written):
        text = "using POMDPs, POMDPTools, PomdpHarness\nFunctionPolicy(b -> pdf(b, true) == 0.5 ? :listen : :left)"
        one = played(tiger, written(text + " => belief_updater"), 50, horizon=1)
        assert (one.returns == -1).all()

    def test_a_policy_with_a_memory_has_one_an_episode(self, tiger, written):
        path = written("""
            using POMDPs
            mutable struct Counting <: Policy
                calls::Int
            end
            POMDPs.action(p::Counting, b) = (p.calls += 1; p.calls == 3 ? :left : :listen)
            Counting(0)
        """)
        one = played(tiger, path, 40, batch_size=11, horizon=5)
        assert set(one.returns) <= {-104.0, 6.0}
        assert len(set(one.returns)) == 2

    def test_same_actions_on_any_number_of_threads(self, written):
        needs_package("BasicPOMCP")
        path = written(f"using BasicPOMCP\n{PLANNERS['BasicPOMCP']}")
        script = (
            "import harness, sys, hashlib; from harness import bridge; "
            f"r = harness.evaluate('rocksample-7x8', {path!r}, episodes=20, horizon=6, engine='julia'); "
            "print(bridge.julia().seval('Threads.nthreads()'), hashlib.sha256(r.returns.tobytes()).hexdigest())"
        )
        seen = {}
        for threads in "12":
            run = subprocess.run(
                [sys.executable, "-W", "ignore", "-c", script],
                env={**os.environ, "PYTHON_JULIACALL_THREADS": threads},
                capture_output=True,
                text=True,
                check=True,
            )
            count, digest = run.stdout.split()
            seen[count] = digest
        assert set(seen) == {"1", "2"}
        assert seen["1"] == seen["2"]


@needs_julia
@pytest.mark.filterwarnings("default")
class TestErrors:
    """One sentence that names file and line, and what to do."""

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("using POMDPTools\nnothing_of_that_name", r"planner\.jl, line 2: UndefVarError"),
            ("1 +\n", r"planner\.jl, line \d: .*premature end of input|ParseError"),
            ("3", r"planner\.jl: it must end in a Policy, a Solver or a function .*, not in a Int64"),
            ("using NoSuchPackage", r"line 1: Julia package NoSuchPackage is not installed: julia --project=.*add"),
            ('using POMDPTools\nfunction f(m)\n  error("no luck")\nend\nf', r"planner\.jl, line 3: no luck"),
        ],
    )
    def test_files_that_are_wrong(self, text, message, tiger, written):
        with pytest.raises(harness.JuliaError, match=message):
            policy.make(written(text), tiger)

    @pytest.mark.parametrize(
        ("body", "message"),
        [
            ('begin\n b\n error("oh dear")\nend', r"planner\.jl, line 4: oh dear"),
            (":sing", r"planner\.jl: .*"),
        ],
    )
    def test_policies_that_fail_on_the_way(self, body, message, tiger, written):
        path = written(f"using POMDPTools\nFunctionPolicy(b -> {body})")
        with pytest.raises(harness.JuliaError, match=message):
            played(tiger, path, 10)


@needs_julia
def test_ctrl_c_ends_a_planner_within_a_step(written):
    """A step of this policy would take a minute and more; Ctrl-C is heard between two episodes."""
    path = written('using POMDPTools\nFunctionPolicy(b -> (println(stderr, "asked"); sleep(1.0); 1))')
    command = [sys.executable, "-u", "-m", "harness", "compare", "rocksample-7x8", "--engine", "julia"]
    with subprocess.Popen(
        [*command, "--policy", path, "--episodes", "1000"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        for line in process.stderr:
            if "asked" in line:
                break
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert err.strip().splitlines()[-1] == "harness: interrupted"
    assert "Traceback" not in err


@needs_julia
@pytest.mark.filterwarnings("default")
class TestSolving:
    def test_alpha_vectors_are_stored_and_played_without_julia(self, tiger, written, tmp_path):
        from harness.solver import solution as solutions
        from harness.solver.julia import solve

        needs_package("PointBasedValueIteration")
        path = written("using PointBasedValueIteration\nPBVISolver(max_iterations = 10)")
        solution = solve(tiger, path, {})
        assert solution.record["solver"].startswith("PointBasedValueIteration ")
        assert solution.record["initial_value"] == pytest.approx(19.37, abs=0.2)  # Cassandra's repository of examples
        solutions.save(tmp_path / "tiger.npz", tiger, solution)
        stored = evaluate(tiger, f"alpha:{tmp_path / 'tiger.npz'}", episodes=3000, horizon=20, engine="tables")
        direct = played(tiger, path, 3000)
        assert agree(stored.discounted, direct.discounted)

    def test_a_value_at_states_is_stored_as_what_actions_are_worth_by_it(self, rocksample, written):
        """Of the fully observed problem's value that makes QMDP, which QMDP.jl has solved."""
        from harness.solver.julia import solve

        path = written(
            "using DiscreteValueIteration, POMDPs, POMDPTools\n"
            "m -> solve(SparseValueIterationSolver(max_iterations = 1000, belres = 1e-9), UnderlyingMDP(m))"
        )
        ours, qmdp = solve(rocksample, path, {}), solve(rocksample, "qmdp", {})
        assert ours.record["solver"].startswith("DiscreteValueIteration ")
        for name in ("visible", "actions"):
            assert np.array_equal(ours.arrays[name], qmdp.arrays[name])
        assert np.allclose(ours.arrays["values"], qmdp.arrays["values"], atol=1e-4)

    def test_a_planner_has_none(self, tiger, written):
        from harness.solver.julia import solve

        with pytest.raises(
            harness.JuliaError, match=r"planner\.jl: a RandomPolicy has neither alpha vectors nor a value"
        ):
            solve(tiger, written("using POMDPTools\nRandomPolicy"), {})


@needs_julia
@pytest.mark.filterwarnings("default")
def test_the_way_back_a_program_in_pomdps_jl_s_simulator(rocksample):
    """Python calls Julia's simulator, which asks Python's policy; the reference is our own evaluation."""
    import juliacall

    scope = juliacall.newmodule("WayBack")
    scope.seval("using PomdpHarness; using PomdpHarness: POMDPs, POMDPTools, Random")
    scope.seval("using .POMDPs, .POMDPTools, .Random")
    play = scope.seval("""(m, policy, episodes) ->
        [simulate(RolloutSimulator(; rng = Xoshiro(k), max_steps = 50), m, policy) for k in 1:episodes]
    """)
    m = bridge.model(rocksample)
    returns = np.array(play(m, bridge.julia().python_policy(m, "rocksample-7x8", "ge-feedback"), 150))
    assert agree(returns, evaluate(rocksample, "ge-feedback", episodes=1000, engine="tables").discounted)


@needs_julia
@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("text", PLANNERS_SHOWN, ids=lambda text: text.splitlines()[0])
def test_the_files_of_the_documentation_run(text, written, rocksample):
    for package in text.splitlines()[0].removeprefix("using ").split(", "):
        needs_package(package)
    assert evaluate(rocksample, written(text), episodes=3, horizon=3, engine="julia").score.episodes == 3
