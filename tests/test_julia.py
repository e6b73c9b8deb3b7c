"""The live engine, the export and the solvers, in a real Julia. Skipped where there is none.

Julia is started once in this process; what must be seen from outside (Ctrl-C) runs in a process of its own.
"""

from __future__ import annotations

import fcntl
import os
import pty
import select
import signal
import struct
import subprocess
import sys
import termios
import time
from pathlib import Path

import numpy as np
import pytest

import harness
from harness import bridge, policy, registry
from harness.engine import rng
from harness.play.evaluation import evaluate, simulate
from harness.play.population import Episodes, play
from harness.policy import alpha
from harness.program import parse, words_of
from harness.solver import solution as solutions

if not bridge.is_set_up():
    pytest.skip("no Julia is set up for the harness (see `harness julia`)", allow_module_level=True)

pytestmark = pytest.mark.filterwarnings("default")

NAMED_7X8 = ("rocksample-7x8", "bordercross-7x8", "bordercross-7x8-random")


def course(domain, spec, engine, episodes, seed=0):
    """Everything that a policy sees and does, step by step."""
    _, made = policy.make(spec, domain)
    made.uses_belief = True
    return [
        (
            None if r.actions is None else r.actions[r.active].copy(),
            r.rewards.copy(),
            r.batch.visible.copy(),
            r.batch.observation.copy(),
            r.batch.marginals.copy(),
            r.batch.done.copy(),
        )
        for r in simulate(domain, made, engine, seed, 0, episodes, 50)
    ]


CASES = [(name, spec) for name in NAMED_7X8 for spec in policy.default_specs(harness.load(name))]
CASES += [("dec-bordercross-7x8-random", spec) for spec in ("team", "team:random,random", "solved")]


@pytest.mark.parametrize(("name", "spec"), CASES)
def test_the_two_engines_give_the_same_episodes_bit_for_bit(name, spec):
    domain = harness.load(name)
    episodes = 20 if spec.startswith("rollout") else 300
    tables, julia = (course(domain, spec, engine, episodes) for engine in ("tables", "julia"))
    assert len(tables) == len(julia)
    for a, b in zip(tables, julia, strict=True):
        for x, y in zip(a, b, strict=True):
            assert np.array_equal(x, y)


@pytest.mark.parametrize("name", sorted(set(registry.names()) - set(NAMED_7X8)))
def test_every_domain_is_stepped_alike_by_both_engines(name):
    domain = harness.load(name)
    tables, julia = (course(domain, "random", engine, 50) for engine in ("tables", "julia"))
    assert len(tables) == len(julia)
    assert all(np.array_equal(x, y) for a, b in zip(tables, julia, strict=True) for x, y in zip(a, b, strict=True))


@pytest.mark.parametrize("shaping", ["paper", "potential"])
def test_shaped_rewards_are_the_same_on_both_engines(shaping, bordercross):
    domain = bordercross.shaped(shaping)
    a, b = (evaluate(domain, "random", episodes=500, engine=engine).returns for engine in ("tables", "julia"))
    assert np.array_equal(a, b)
    assert not np.array_equal(a, evaluate(bordercross, "random", episodes=500, engine="tables").returns)


@pytest.mark.parametrize("shaping", ["none", "potential"])
def test_programs_return_the_same_on_both_engines(shaping, hidden):
    domain = hidden.shaped(shaping)
    texts = [
        "if(distance() < 4) down(1) else right(2) while(distance() > 1) right(1) cooperate()",
        "loop if(belief(5) > 0.2 or distance() == 2) left(2) else up(1)",
        "right(1) right(1)",
    ]
    _play_on_both(domain, texts)


@pytest.mark.parametrize("shaping", ["none", "potential"])
def test_programs_of_agents_return_the_same_on_both_engines(shaping):
    texts = [
        "agent(1): loop if(distance() < 3) right() else down() agent(2): right() while(distance() > 1) right()",
        "agent(1): right() if(distance() == '3') down() agent(2): loop if(distance() < 4) cooperate() else right()",
    ]
    _play_on_both(harness.load("dec-bordercross-7x8-random").shaped(shaping), texts)


def _play_on_both(domain, texts):
    programs = [parse(text, words_of(domain)) for text in texts]
    tables, julia = (play(domain, programs, Episodes(2, 10, 200, 40), engine) for engine in ("tables", "julia"))
    for here, there in zip(tables, julia, strict=True):
        assert np.array_equal(here, there)


def test_evolution_takes_the_same_course_on_both_engines():
    small = {"population": 12, "generations": 3, "episodes": 20, "max_init_depth": 15, "score_episodes": 50}
    tables, julia = (harness.evolve("rocksample-7x8", engine=engine, **small) for engine in ("tables", "julia"))
    columns = [name for name in tables.history if name != "seconds"]
    assert tables.history[columns].equals(julia.history[columns])
    assert tables.best.text == julia.best.text
    assert tables.best.score == julia.best.score


def test_a_user_s_model_is_searched_with_a_grammar_of_its_words(tiger):
    """Tiger: listening once and opening the other door beats opening at random (−45 a door) by far."""
    best = harness.evolve(tiger, loop=True, population=60, generations=15, horizon=10, max_init_depth=12).best
    assert best.score.mean > -20
    assert "listen" in best.text


@pytest.mark.parametrize("name", registry.names())
def test_snapshots_are_what_julia_exports_now(name):
    assert bridge.export(name).model_hash == harness.load(name).model_hash


def test_the_notebook_s_snapshot_is_what_its_model_gives_now():
    folder = Path(__file__).parent.parent / "notebooks" / "tiger"
    assert harness.load(folder / "tiger.jl").model_hash == harness.load(folder / "tiger.npz").model_hash


@pytest.mark.parametrize("name", [*NAMED_7X8, "dec-bordercross-7x8", "dec-bordercross-7x8-random"])
def test_snapshot_against_the_julia_functions_for_all_states_and_actions(name):
    """transition, observation and reward are called for every state and action, and compared with the tables."""
    domain = harness.load(name)
    t = domain.tables
    every = bridge.julia().seval(
        """m -> begin
            keep(s) = !isterminal(m, s)
            rows = Tuple{Int,Int,Int,Float64,Vector{Float64},Vector{Int}}[]
            for s in filter(keep, collect(states(m))), a in actions(m)
                sp = only(support(transition(m, s, a)))
                o = observation(m, s, a, sp)
                ks = eachindex(factor_sizes(m))
                hidden = [factor_value(m, s, k) - 1 for k in ks]
                after = isterminal(m, sp) ? hidden : [factor_value(m, sp, k) - 1 for k in ks]
                v, vp = visible_index(m, s) - 1, visible_index(m, sp) - 1
                push!(rows, (v, actionindex(m, a) - 1, vp, reward(m, s, a, sp),
                             [pdf(o, x) for x in observations(m)], [hidden; after]))
            end
            return (stack([[r[1], r[2], r[3]] for r in rows]; dims = 1), [r[4] for r in rows],
                    stack([r[5] for r in rows]; dims = 1), isempty(rows[1][6]) ? zeros(Int, length(rows), 0) :
                    stack([r[6] for r in rows]; dims = 1))
        end"""
    )(bridge.model(domain))
    index, rewards, readings, hidden = (np.array(a) for a in every)
    k_count = len(domain.factors)
    va = index[:, 0] * domain.n_actions + index[:, 1]
    factor = t.choices["factor"][va]
    row = t.choices["first_row"][va].copy()
    touched = factor >= 0
    row[touched] += hidden[touched, factor[touched]]
    assert (t.rows["last"][row] - t.rows["first"][row] == 1).all()
    outcome = t.outcomes[t.rows["first"][row]]
    assert np.array_equal(outcome["visible"], index[:, 2])
    assert np.array_equal(outcome["reward"], rewards)
    assert np.array_equal(t.reading_probability[outcome["reading"]], readings)
    after = hidden[:, :k_count].copy()
    live = touched & ~outcome["ends"]
    after[live, factor[live]] = outcome["value"][live]
    assert np.array_equal(after, hidden[:, k_count:])
    assert len(va) == (domain.n_states - 1) * domain.n_actions


@pytest.mark.parametrize("name", registry.names())
def test_the_engine_conforms(name):
    harness.check_domain(name, engine="julia", episodes=200)


def test_arrays_are_shared_not_copied(rocksample):
    from harness.engine.julia import JuliaEngine

    engine = JuliaEngine(rocksample, 10, True)
    before = engine.visible.ctypes.data, engine.marginals.ctypes.data
    engine.reset(rng.uniforms(0, rng.ENGINE, 0, 0, 10))
    engine.step(np.full(10, rocksample.action("right()"), dtype=np.int32), rng.uniforms(0, rng.ENGINE, 1, 0, 10))
    assert (engine.visible.ctypes.data, engine.marginals.ctypes.data) == before
    assert (rocksample.visible_values[engine.visible] == [2, 4]).all()


@pytest.fixture(scope="module")
def tiger(tmp_path_factory):
    path = tmp_path_factory.mktemp("model") / "tiger.jl"
    models = bridge.package_folder() / "test" / "models.jl"
    path.write_text(f'using POMDPs, POMDPTools\ninclude(raw"{models}")\nTiger()\n')
    return harness.load(str(path))


class TestUsersOwnModel:
    """A POMDPs.jl model with no Python written for it."""

    def test_it_is_a_domain(self, tiger):
        assert tiger.name == "tiger"
        assert tiger.actions == ("listen", "left", "right")
        assert tiger.n_joint == 2

    def test_both_engines_play_it_the_same(self, tiger):
        for spec in ("random", "rollout:8"):
            for a, b in zip(*(course(tiger, spec, engine, 50) for engine in ("tables", "julia")), strict=True):
                assert all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))

    def test_it_conforms(self, tiger):
        harness.check_domain(tiger, engine="julia")

    def test_sarsop_reaches_the_published_value(self, tiger, tmp_path):
        """Tiger's optimal value at discount 0.95 is 19.37 (Cassandra's repository of examples)."""
        from harness.solver.julia import solve

        solution = solve(tiger, "sarsop", {"timeout": 20})
        assert solution.record["lower"] == pytest.approx(19.37, abs=0.01)
        solutions.save(tmp_path / "tiger.npz", tiger, solution)
        made = alpha.AlphaVectorPolicy(tiger, solutions.read(tmp_path / "tiger.npz", tiger))
        score = evaluate(tiger, made, episodes=4000, horizon=200, engine="tables").score
        assert abs(score.discounted_mean - 19.37) < 4 * score.discounted_sem


def test_errors_of_julia_are_one_sentence(tmp_path):
    path = tmp_path / "broken.jl"
    path.write_text("1 + ")
    with pytest.raises(harness.JuliaError):
        harness.load(str(path))
    path.write_text("1 + 1")
    with pytest.raises(harness.JuliaError, match=r"must be a POMDPs\.jl model"):
        harness.load(str(path))
    with pytest.raises(harness.JuliaError, match="no domain 'nowhere'; known: rocksample-4x4"):
        bridge.export("nowhere")


@pytest.mark.parametrize("solver", ["qmdp", "native-sarsop"])
def test_solvers_agree_with_the_stored_policies(solver, bordercross):
    from harness.solver.julia import solve

    limits = {"timeout": 60.0} if solver == "native-sarsop" else {}
    assert solve(bordercross, solver, limits).record["initial_value"] == pytest.approx(500 * 0.95**11, abs=1e-3)


def test_ctrl_c_with_julia_and_its_threads(tmp_path):
    """A real SIGINT while the julia engine steps: status 130, no traceback, no crash."""
    command = [sys.executable, "-u", "-m", "harness", "compare", "rocksample-7x8", "--engine", "julia"]
    command += ["--policy", "belief", "--episodes", "100000000"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        time.sleep(12)
        assert process.poll() is None
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert err.strip().splitlines()[-1] == "harness: interrupted"
    assert "Traceback" not in err


def test_ctrl_c_stops_sarsop_and_keeps_what_it_has(tmp_path, rocksample):
    """On a terminal of its own, where the solver's bounds are shown as they come."""
    path = tmp_path / "early.npz"
    command = [sys.executable, "-u", "-m", "harness", "solve", "rocksample-7x8", "--solver", "sarsop", "--time", "600"]
    terminal, theirs = pty.openpty()
    fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 120, 0, 0))  # tqdm draws nothing on no columns
    with subprocess.Popen(
        [*command, "--out", str(path)], stdout=subprocess.PIPE, stderr=theirs, text=True, start_new_session=True
    ) as process:
        os.close(theirs)
        err = shown(terminal, until="lower")
        os.killpg(process.pid, signal.SIGINT)  # what a terminal does
        err += shown(terminal)
        out = process.stdout.read()
    os.close(terminal)
    assert process.returncode == 0, err
    assert "stopped early by Ctrl-C" in out
    solution = solutions.read(path, rocksample)
    assert solution.record["lower"] == pytest.approx(solution.record["initial_value"], abs=1e-3)
    assert solution.record["seconds"] < 60


def shown(terminal, until=None):
    """What a program shows on its terminal until a word comes up, or until it ends."""
    text = ""
    while until is None or until not in text:
        assert select.select([terminal], [], [], 120)[0], f"nothing new for two minutes after {text[-300:]!r}"
        try:
            more = os.read(terminal, 4096)
        except OSError:  # how Linux says that the other end is closed
            more = b""
        if not more:
            assert until is None, text
            break
        text += more.decode(errors="replace")
    return text
