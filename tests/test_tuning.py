"""Tuning: the methods against closed forms and hand-worked steps, runs against interruption, damage and misuse."""

from __future__ import annotations

import json
import math
import re
import signal
import subprocess
import sys
import time
from dataclasses import fields

import numpy as np
import pytest

import harness
from harness.cli import main
from harness.engine import rng
from harness.play.evaluation import evaluate
from harness.tuning import journal, resume, run, tunable
from harness.tuning.ascent import ForwardDifference
from harness.tuning.method import configure
from harness.tuning.objective import Episodes
from harness.tuning.run import METHODS, climb
from harness.tuning.score import ScoreFunction
from tests.conftest import size
from tests.test_cli import NO_JULIA, PATIENCE

QUICK = {  # settings that make a run on real episodes short
    "gradient": {"episodes": 300, "iterations": 6},
    "spsa": {"episodes": 300, "iterations": 6},
    "score": {"episodes": 40, "pairs": 5, "iterations": 6},
    "cmaes": {"episodes": 300, "iterations": 6},
    "lines": {"episodes": 300, "iterations": 6, "resolution": 0.0005},
    "autodiff": {"episodes": 300, "iterations": 6, "situations": 20},
}


class Space:
    """Numbers without a policy, for objectives with a closed form."""

    def __init__(self, start, lower=0.0, upper=1.0):
        self.start = np.array(start, dtype=float)
        self.names = tuple(f"x{i}" for i in range(len(start)))
        self.lower = np.full(len(start), lower)
        self.upper = np.full(len(start), upper)

    def policy(self, theta):
        raise NotImplementedError

    def text(self, theta):
        return str(theta)


class Noisy:
    """An objective whose episodes differ by noise that belongs to the episode, as the harness's does.

    A soft ask has no noise, and difference quotients for a gradient.
    """

    def __init__(self, function, noise=3.0):
        self.function, self.noise = function, noise

    def __call__(self, ask):
        rows = []
        for point, first in zip(ask.points, ask.first, strict=True):
            draws = np.random.default_rng(int(first)).normal(size=ask.episodes)
            rows.append(self.function(point) + self.noise * draws)
        return np.array(rows)

    def smooth(self, ask):
        (point,), width = ask.points, 1e-6
        ends = [[self.function(point + sign * width * axis) for sign in (1, -1)] for axis in np.eye(len(point))]
        return np.array([self.function(point), *((up - down) / (2 * width) for up, down in ends)])


def run_on(function, method, space, **settings):
    search = configure(METHODS[method], space, 3, settings)
    kept = journal.Journal(space.names)
    stopped, _ = climb(search, Noisy(function), kept)
    return search, kept.table(), stopped


class TestMethods:
    @pytest.mark.parametrize(
        ("method", "settings"),
        [
            ("gradient", {"episodes": 50}),
            ("spsa", {"episodes": 50}),
            ("score", {"episodes": 10}),
            ("cmaes", {"episodes": 50}),
            ("lines", {"episodes": 50}),
            ("autodiff", {}),
        ],
    )
    @pytest.mark.parametrize("start", [[0.75, 0.45], [0.6, 0.6]])
    def test_the_top_of_a_paraboloid_is_found(self, method, settings, start):
        top = np.array([0.7, 0.55])
        search, table, _ = run_on(lambda x: -100 * ((x - top) ** 2).sum(), method, Space(start), **settings)
        assert np.abs(search.theta - top).max() < 0.03
        assert table["value"].iloc[-1] > table["value"].iloc[0] - 3

    @pytest.mark.parametrize("method", METHODS)
    def test_a_top_beyond_the_bounds_is_approached_within_them(self, method):
        settings = {"episodes": 20} if method != "score" else {"episodes": 5}
        search, table, _ = run_on(lambda x: 40 * x.sum(), method, Space([0.8], 0.5, 0.9), **settings)
        assert table["x0"].between(0.5, 0.9).all()
        assert search.theta[0] == pytest.approx(0.9, abs=0.03)

    @pytest.mark.parametrize("method", [m for m in METHODS if m not in ("lines", "autodiff")])  # one set; none
    def test_iterations_play_episodes_of_their_own(self, method):
        _, table, _ = run_on(lambda x: x.sum(), method, Space([0.3, 0.5]), episodes=7, iterations=4)
        spans = [set(range(f, f + 7)) for f in sorted(table["first"].unique())]
        assert len(set.union(*spans)) == sum(map(len, spans))
        assert table.groupby("first")["iteration"].nunique().eq(1).all()
        assert table.groupby("first")["point"].nunique().ge(2).all()  # whatever is compared shares its episodes

    def test_table_3_by_hand(self):
        """On a line of slope 0.4: α = 0.05, 0.05, 0.05·e^(−1/20), …; v ← 0.2·v + 0.4·α."""
        _, table, _ = run_on(lambda x: 0.4 * x[0], "gradient", Space([0.6], 0.5), episodes=2, iterations=4)
        each = table[table["point"] == 0]
        rates = [0.05, 0.05, 0.05 * math.exp(-1 / 20), 0.05 * math.exp(-1 / 20) * math.exp(-2 / 20)]
        v = [0.02, 0.024, 0.0048 + 0.4 * rates[2]]
        assert each["rate"].tolist() == pytest.approx(rates)
        assert each["velocity_x0"].tolist()[:3] == pytest.approx(v)
        assert each["theta_x0"].tolist() == pytest.approx([0.6, 0.62, 0.644, 0.644 + v[2]])
        assert each["gradient_x0"].tolist() == pytest.approx([0.4] * 4)
        assert table[table["point"] == 1]["x0"].tolist() == pytest.approx([x + 0.01 for x in each["theta_x0"]])

    def test_gradient_and_momentum_are_clipped(self):
        _, table, _ = run_on(lambda x: 100 * x[0], "gradient", Space([0.5], 0.5), episodes=2, iterations=3)
        each = table[table["point"] == 0]
        assert each["gradient_x0"].tolist() == pytest.approx([100] * 3)
        assert each["velocity_x0"].tolist() == pytest.approx([0.05] * 3)  # unclipped: 0.05, 0.06, …
        _, table, _ = run_on(
            lambda x: -100 * x[0], "gradient", Space([0.9], 0.5), episodes=2, iterations=3, velocity_clip=1,
            gradient_clip=2,
        )  # fmt: skip
        v = [-0.1, -0.12, -0.024 - 0.1 * math.exp(-1 / 20)]
        assert table[table["point"] == 0]["velocity_x0"].tolist() == pytest.approx(v)

    def test_at_the_upper_bound_the_difference_is_taken_backward(self):
        search = ForwardDifference(Space([0.995, 0.3]), 0)
        ask = search.ask(0)
        assert ask.points == pytest.approx(np.array([[0.995, 0.3], [0.985, 0.3], [0.995, 0.31]]))
        move = search.tell(0, ask, np.array([5.0, 5.5, 5.02]))
        assert move.gradient == pytest.approx([-50, 2])

    def test_the_reason_for_the_stop_is_true(self):
        _, table, stopped = run_on(lambda x: -((x[0] - 0.7) ** 2), "gradient", Space([0.68], 0.5), episodes=3)
        last = table["step"].iloc[-1]
        assert last < 0.001 <= table.drop_duplicates("iteration")["step"].iloc[:-1].min()
        count = table["iteration"].nunique()
        assert stopped.startswith(f"the step {last:.2g} is below the tolerance 0.001 after {count} iteration")
        _, table, stopped = run_on(lambda x: 0.0, "gradient", Space([0.68], 0.5), episodes=3)
        assert "the gradient is 0 after 1 iteration" in stopped
        assert len(table) == 2
        assert run_on(lambda x: x[0], "spsa", Space([0.68]), episodes=3, iterations=4)[2] == "all 4 iterations are done"

    def test_spsa_by_hand(self):
        """Gains a/(A+k+1)^α and c/(k+1)^γ; all numbers perturbed at once, by ±c_k."""
        slope = np.array([3.0, -2.0])
        search, table, _ = run_on(lambda x: x @ slope, "spsa", Space([0.5, 0.5]), episodes=2, iterations=3)
        for k, points in table.groupby("iteration"):
            theta = points[["theta_x0", "theta_x1"]].iloc[0].to_numpy()
            offset = points[["x0", "x1"]].to_numpy() - theta
            assert np.abs(offset) == pytest.approx(np.full((2, 2), 0.02 / (k + 1) ** 0.101))
            assert offset[0] == pytest.approx(-offset[1])
            signs = np.sign(offset[0])
            ghat = (slope @ signs) / signs
            assert points[["gradient_x0", "gradient_x1"]].iloc[0].tolist() == pytest.approx(ghat)
            after = theta + 0.005 / (5 + k + 1) ** 0.602 * ghat
        assert search.theta == pytest.approx(after)

    def test_cmaes_leaves_the_global_generator_alone(self):
        np.random.seed(4)  # noqa: NPY002
        before = np.random.get_state()[1].copy()  # noqa: NPY002
        run_on(lambda x: -((x[0] - 0.3) ** 2), "cmaes", Space([0.6]), episodes=2, iterations=3)
        assert np.array_equal(before, np.random.get_state()[1])  # noqa: NPY002

    def test_cmaes_says_that_it_is_on_a_plateau(self):
        search = configure(METHODS["cmaes"], Space([0.55], 0.5), 3, {"episodes": 20, "patience": 4})
        stopped, _ = climb(search, Noisy(lambda x: 1.0), journal.Journal(("x0",)))
        assert "tolflatfitness 4" in stopped


class TestScoreFunction:
    def test_the_gradient_of_a_softened_step_is_the_normal_density(self):
        """J(θ) = 1 above c, so J_s(θ) = Φ((θ − c) / s), and its slope is φ((θ − c) / s) / s."""
        theta, c, s = 0.5, 0.52, 0.03
        search = ScoreFunction(Space([theta]), 1, spread=s, pairs=4000, episodes=2)
        terms = search.terms(0, (search.ask(0).points[:, 0] > c).astype(float))[:, 0]
        exact = math.exp(-(((theta - c) / s) ** 2) / 2) / math.sqrt(2 * math.pi) / s
        error = terms.std(ddof=1) / math.sqrt(len(terms))
        assert terms.mean() == pytest.approx(exact, abs=4 * error)
        assert error < 0.1 * exact  # or the comparison would mean nothing

    def test_it_agrees_with_a_finite_difference_on_rocksample(self, rocksample):
        """J_s by quadrature over hard thresholds, on other episodes; the slope over ± 0.004 of it."""
        theta, s, h = 0.945, 0.01, 0.004
        nodes, weights = np.polynomial.hermite_e.hermegauss(15)
        weights = weights / weights.sum()
        subject = tunable("belief", rocksample)

        def softened(at):
            points = np.clip(at + s * nodes, 0.5, 1.0)
            return weights @ np.array(
                [evaluate(rocksample, subject.policy(np.array([x])), episodes=1500, seed=5, engine="tables").returns
                 for x in points]
            )  # fmt: skip

        difference = (softened(theta + h) - softened(theta - h)) / (2 * h)
        subject.start[0] = theta
        search = ScoreFunction(subject, 0, spread=s, pairs=120, episodes=100)
        ask = search.ask(0)
        terms = search.terms(0, Episodes(rocksample, subject, 0, 50, "return", "tables")(ask).mean(axis=1))[:, 0]
        errors = [x.std(ddof=1) / math.sqrt(len(x)) for x in (difference, terms)]
        assert terms.mean() == pytest.approx(difference.mean(), abs=4 * math.hypot(*errors))
        assert terms.mean() > 3 * errors[1]  # the slope is seen at all


class TestSweep:
    def test_rows_are_what_evaluate_says(self, rocksample):
        table = harness.sweep(rocksample, "belief", start=0.8, stop=1, points=5, episodes=300, seed=3, engine="tables")
        assert table["threshold"].tolist() == [0.8, 0.85, 0.9, 0.95, 1.0]
        for _, row in table.iterrows():
            score = evaluate(rocksample, row["policy"], episodes=300, seed=3, engine="tables").score
            assert row[list(score._fields)].tolist() == list(score)

    def test_one_of_several_numbers(self, rocksample):
        table = harness.sweep(rocksample, "thresholds:wait=0.5", [0.6, 0.9], parameter="accept", episodes=50)
        assert all("wait=0.5" in policy for policy in table["policy"])
        assert table["accept"].tolist() == [0.6, 0.9]

    def test_the_command_writes_csv_and_a_figure(self, capsys, tmp_path):
        from matplotlib.image import imread

        arguments = ["--policy", "accuracy", "--from", "0.9", "--to", "1", "--points", "3", "--episodes", "50"]
        assert main(["sweep", "rocksample-7x8", *arguments, "--engine", "tables", "--out", str(tmp_path)]) == 0
        out = capsys.readouterr().out
        table = harness.sweep("rocksample-7x8", "accuracy", [0.9, 0.95, 1.0], episodes=50, engine="tables")
        assert (tmp_path / "sweep.csv").read_text() == table.to_csv(index=False)
        assert f"{table['mean'].max():.2f} ± " in out
        picture = imread(tmp_path / "sweep.png")
        assert picture.shape[1] > 1000
        assert picture[..., :3].std() > 0.02  # something is drawn


class TestRuns:
    @pytest.mark.parametrize(("word", "starts"), [("accuracy", (0.6, 0.75, 0.95)), ("belief", (0.92, 0.95, 0.99))])
    def test_the_papers_ascent_ends_on_the_top_of_the_sweep(self, rocksample, word, starts):
        """From either side. On the plateau of accuracy (0.5 to 0.9, its top) it stays where it starts."""
        table = harness.sweep(rocksample, word, start=0.5, stop=1, points=51, episodes=2000, engine="tables")
        best = table.loc[table["mean"].idxmax()]
        for start in starts:
            result = harness.tune(rocksample, f"{word}:{start}", episodes=2000, final_episodes=2000, engine="tables")
            end = evaluate(rocksample, result.best.policy, episodes=2000, engine="tables").score
            assert end.mean > best["mean"] - 3 * best["sem"]

    @pytest.mark.parametrize("method", size([m for m in METHODS if m != "autodiff"], METHODS))  # a minute of compiling
    def test_interrupted_anywhere_and_resumed_it_is_the_same_run(self, rocksample, method, tmp_path, monkeypatch):
        def go(folder, **more):
            return harness.tune(
                rocksample, "belief:0.93", method=method, out=folder, final_episodes=200, engine="tables", workers=1,
                **QUICK[method], **more,
            )  # fmt: skip

        whole = go(tmp_path / "whole")
        calls, answer = [], "smooth" if method == "autodiff" else "__call__"
        play = getattr(Episodes, answer)

        def stop_at_the_third(self, ask):
            calls.append(1)
            if len(calls) % 3 == 0:
                raise KeyboardInterrupt
            return play(self, ask)

        monkeypatch.setattr(Episodes, answer, stop_at_the_third)
        with pytest.raises(KeyboardInterrupt):
            go(tmp_path / "cut")
        assert not (tmp_path / "cut" / "result.json").exists()
        with pytest.raises(KeyboardInterrupt):
            go(tmp_path / "cut", resume=True)
        monkeypatch.undo()
        again = resume(tmp_path / "cut", engine="tables")
        for name in ("config.json", "history.csv", "result.json"):
            assert (tmp_path / "cut" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
        assert again.best == whole.best
        assert again.stopped == whole.stopped
        assert again.history.equals(whole.history)

    def test_the_result_can_be_scored_again(self, rocksample, tmp_path):
        result = harness.tune(
            rocksample, "belief:0.93", seed=4, episodes=300, final_episodes=400, out=tmp_path, engine="tables"
        )
        (theta,) = result.best.theta.values()
        assert result.best.policy == f"belief:{theta!r}"
        assert theta == round(theta, 4)
        fresh = evaluate(rocksample, result.best.policy, episodes=400, seed=(1 << 61) + 4, engine="tables").score
        assert result.best.score == fresh
        last = result.history["first"].max()
        seen = evaluate(
            rocksample, result.best.policy, episodes=300, seed=(1 << 62) + 4, first=int(last), engine="tables"
        ).score
        assert result.best.training == seen
        row = result.history.iloc[0]
        again = evaluate(rocksample, "belief:0.93", episodes=300, seed=(1 << 62) + 4, engine="tables").score
        assert [row["value"], row["sem"]] == [again.mean, again.sem]
        assert json.loads((tmp_path / "result.json").read_text())["stopped"] == result.stopped
        config = json.loads((tmp_path / "config.json").read_text())
        assert config["run"]["epsilon"] == 0.01
        assert {"python", "numpy", "cma"} <= set(config["versions"])
        result.plot().savefig(tmp_path / "history.png")

    def test_the_discounted_return_is_another_measure(self, rocksample):
        table = harness.tune(
            rocksample, "belief:0.93", measure="discounted", episodes=200, iterations=1, engine="tables"
        ).history
        expected = evaluate(rocksample, "belief:0.93", episodes=200, seed=rng.TRAINING, engine="tables").score
        assert table["value"].iloc[0] == expected.discounted_mean

    def test_any_tunable_will_do(self, rocksample):
        """A policy of the user's own: check rock 3 a number of times that a parameter sets, then leave."""

        class Waits:
            def __init__(self, share):
                self.steps = round(20 * share)

            def reset(self, batch):
                pass

            def act(self, batch):
                name = "check(3)" if batch.step < self.steps else "right()"
                return np.full(batch.size, batch.domain.action(name))

        class WaitsTunable(Space):
            def policy(self, theta):
                return Waits(theta[0])

            def text(self, theta):
                return f"wait {theta[0]:.2f}"

        result = harness.tune(
            rocksample, WaitsTunable([0.9]), method="cmaes", measure="discounted", episodes=2, iterations=15,
            final_episodes=2, engine="tables",
        )  # fmt: skip
        assert result.best.score.discounted_mean == pytest.approx(10 * 0.95**6)
        assert result.best.policy.startswith("wait 0.0")


def start_run(folder):
    arguments = ["--policy", "belief:0.92", "--method", "spsa", "--seed", "3", "--engine", "tables"]
    settings = ["--set", "episodes=20000", "--set", "iterations=15"]
    command = [sys.executable, "-m", "harness", "tune", "rocksample-7x8", *arguments, *settings, "--out", str(folder)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=NO_JULIA)
    history = folder / "history.csv"
    while not (history.exists() and history.read_text().count("\n") > 6) and process.poll() is None:
        time.sleep(0.005)
    return process


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    harness.tune(
        "rocksample-7x8", "belief:0.92", method="spsa", seed=3, engine="tables", episodes=20_000, iterations=15,
        out=folder,
    )  # fmt: skip
    return folder


class TestProcesses:
    def test_killed_and_resumed_it_is_the_same_run(self, tmp_path, uninterrupted, capsys):
        process = start_run(tmp_path / "cut")
        process.send_signal(signal.SIGKILL)
        process.communicate(timeout=PATIENCE)
        assert process.returncode == -signal.SIGKILL
        before = (tmp_path / "cut" / "history.csv").read_bytes()
        whole = (uninterrupted / "history.csv").read_bytes()
        assert whole.startswith(before)
        assert 6 < before.count(b"\n") < whole.count(b"\n")
        assert main(["tune", "--resume", str(tmp_path / "cut"), "--engine", "tables"]) == 0
        for name in ("config.json", "history.csv", "result.json"):
            assert (tmp_path / "cut" / name).read_bytes() == (uninterrupted / name).read_bytes()
        out = capsys.readouterr().out
        assert "stopped: all 15 iterations are done" in out
        assert "on fresh episodes" in out
        assert (tmp_path / "cut" / "history.png").stat().st_size > 10_000

    def test_ctrl_c_leaves_everything_whole(self, tmp_path, uninterrupted):
        process = start_run(tmp_path / "cut")
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=PATIENCE)
        assert process.returncode == 130
        assert "harness tune --resume" in err
        assert "Traceback" not in err
        assert (uninterrupted / "history.csv").read_bytes().startswith((tmp_path / "cut" / "history.csv").read_bytes())
        assert {p.name for p in (tmp_path / "cut").iterdir()} == {"config.json", "history.csv"}


class TestMisuse:
    @pytest.fixture
    def folder(self, rocksample, tmp_path):
        harness.tune(
            rocksample,
            "belief:0.93",
            episodes=50,
            iterations=3,
            final_episodes=50,
            out=tmp_path / "run",
            engine="tables",
        )
        return tmp_path / "run"

    def misuse(self, capsys, *arguments):
        try:
            status = main([str(a) for a in arguments])
        except SystemExit as error:
            status = error.code
        captured = capsys.readouterr()
        assert status == 2
        assert captured.out == ""
        assert captured.err.startswith("harness: ")
        assert captured.err.count("\n") == 1
        assert len(captured.err) < 320
        return captured.err

    @pytest.mark.parametrize(
        ("arguments", "words"),
        [
            (["tune", "rocksample-7x8", "--policy", "belief", "--method", "newton"], "invalid choice: 'newton'"),
            (["tune", "rocksample-7x8", "--policy", "belief:0.4"], "0.4 is out of range"),
            (["tune", "rocksample-7x8", "--policy", "thresholds:acept=0.4"], "did you mean 'accept'"),
            (["tune", "rocksample-7x8", "--policy", "sarsop"], "no numbers to tune"),
            (["tune", "bordercross-7x8", "--policy", "belief"], "needs a rocksample domain"),
            (["tune", "rocksample-7x8"], "needs a DOMAIN and a --policy"),
            (["tune", "rocksample-7x8", "--policy", "belief", "--set", "epsilom=1"], "did you mean 'epsilon'"),
            (["tune", "rocksample-7x8", "--policy", "belief", "--set", "epsilon=3"], "epsilon must be a number from"),
            (["tune", "rocksample-7x8", "--policy", "belief", "--set", "episodes=3.5"], "episodes must be a whole"),
            (["tune", "rocksample-7x8", "--policy", "belief", "--set", "epsilon"], "not of the form NAME=X"),
            (["tune", "rocksample-7x8", "--policy", "belief", "--set", "final_episodes=2.5"], "from 2 to 10,000,000"),
            (["tune", "rocksample-7x8", "--policy", "belief", "--set", "validation_episodes=1"], "from 2 to 10,000,00"),
            (["tune", "rocksample-7x8", "--policy", "belief", "--set", "episodes=6000000"], "would play 12,000,000"),
            (["tune", "rocksample-7x8", "--policy", "belief", "--set", "rate=1e300"], "from 1e-09 to 1,000,000, not"),
            (["tune", "rocksample-7x8", "--policy", "belief", "--set", f"rate={'9' * 5000}"], "is not a whole number"),
            (["tune", "rocksample-7x8", "--policy", "belief", "--set", "rate=inf"], "'inf' is not a number"),
            (["tune", "rocksample-7x8", "--policy", "belief", "--set", "run=3"], "no setting 'run'"),
            (["tune", "rocksample-7x8", "--policy", "belief", "--set", "domain=3"], "domain is no setting"),
            (["tune", "rocksample-7x8", "--policy", "belief", "--horizon", 10**9], "horizon must be a whole number"),
            (["sweep", "rocksample-7x8", "--policy", "belief", "--horizon", 10**9], "horizon must be a whole number"),
            (["sweep", "rocksample-7x8", "--policy", "belief", "--episodes", 10**9], "from 1 to 10,000,000"),
            (["sweep", "rocksample-7x8", "--policy", "belief", "--points", 10**9], "10,000 at most"),
            (["sweep", "rocksample-7x8"], "needs a DOMAIN and a --policy"),
            (["sweep", "--resume", "no-such-folder"], "holds no run to resume (there is no sweep.json)"),
            (
                ["tune", "rocksample-7x8", "--policy", "belief", "--seed", 2**61],
                "--seed: '2305843009213693952' is not a whole number from 0 to 2,305,843,",
            ),
            (["tune", "rocksample-7x8", "--policy", "belief", "--out", "/dev/null/x"], "cannot write"),
            (["tune", "rocksample-7x8", "--policy", "belief", "--set", "seed=3"], "use --seed"),
            (["tune", "rocksample-7x8", "--policy", "belief", "--set", "workers=3"], "workers is no setting"),
            (["tune", "--resume", "no-such-folder"], "holds no run to resume"),
            (["sweep", "rocksample-7x8", "--policy", "belief", "--to", "1.5"], "1.5 is out of range"),
            (["sweep", "rocksample-7x8", "--policy", "belief", "--from", "0.9", "--to", "0.8"], "goes upward"),
            (["sweep", "rocksample-7x8", "--policy", "belief", "--points", "1"], "2 points or more"),
            (["sweep", "rocksample-7x8", "--policy", "belief", "--from", "x"], "'x' is not a number"),
            (["sweep", "rocksample-7x8", "--policy", "thresholds"], "name the parameter to vary, one of: accept"),
            (["sweep", "rocksample-7x8", "--policy", "thresholds", "--parameter", "wat"], "did you mean 'wait'"),
            (["sweep", "rocksample-7x8", "--policy", "exit"], "no numbers to tune"),
        ],
    )
    def test_misuse_gets_one_sentence(self, capsys, arguments, words):
        assert words in self.misuse(capsys, *arguments)

    def test_in_python_too(self, rocksample):
        with pytest.raises(harness.HarnessError, match="did you mean 'gradient'"):
            harness.tune(rocksample, "belief", method="gradien")
        with pytest.raises(harness.HarnessError, match="no measure 'discount'"):
            harness.tune(rocksample, "belief", measure="discount")
        with pytest.raises(harness.PolicyError, match="Tunable protocol"):
            harness.tune(rocksample, object())

    def test_another_run_is_not_overwritten(self, capsys, folder):
        before = {p.name: p.read_bytes() for p in folder.iterdir()}
        err = self.misuse(capsys, "tune", "rocksample-7x8", "--policy", "belief:0.95", "--out", folder)
        assert "already holds a run" in err
        for other in (["--seed", "8"], ["--method", "spsa"], ["--set", "epsilon=0.02"], ["--policy", "belief:0.6"]):
            err = self.misuse(capsys, "tune", "--resume", folder, *other)
            name = other[1].split("=")[0] if other[0] == "--set" else other[0][2:]
            assert f"has {name} " in err
        assert {p.name: p.read_bytes() for p in folder.iterdir()} == before

    @pytest.mark.parametrize(
        "damage",
        [
            lambda text: text[: len(text) // 2],
            lambda text: text[: text.rindex("\n0,1") + 1] + text[text.index("\n1,0") + 1 :],  # a row is gone
            lambda text: text.replace("\n1,0,50,50,0.", "\n1,0,50,50,0.1"),
            lambda text: text.replace("\n2,", "\n3,"),
            lambda text: "",
            lambda text: "\x00" + text,
            lambda text: text + text.splitlines()[-2] + "\n",
        ],
    )
    def test_a_damaged_history_is_refused(self, capsys, folder, damage):
        path = folder / "history.csv"
        text = path.read_text()
        assert damage(text) != text
        path.write_text(damage(text))
        assert "history.csv is damaged" in self.misuse(capsys, "tune", "--resume", folder, "--engine", "tables")
        assert path.read_text() == damage(text)

    @pytest.mark.parametrize(
        "text", ["", "{", "[]", '{"run": 3}', '{"run": {}}', '{"run": {"domain": "rocksample-7x8"}}']
    )
    def test_a_damaged_configuration_is_refused(self, capsys, folder, text):
        (folder / "config.json").write_text(text)
        assert "config.json is damaged" in self.misuse(capsys, "tune", "--resume", folder)
        assert (folder / "config.json").read_text() == text

    def test_a_changed_configuration_is_refused(self, capsys, folder):
        path = folder / "config.json"
        path.write_text(path.read_text().replace('"epsilon": 0.01', '"epsilon": "x"'))
        assert "config.json is damaged" in self.misuse(capsys, "tune", "--resume", folder)


@pytest.mark.parametrize("method", METHODS)
def test_the_help_names_every_setting_with_its_default(method, capsys):
    with pytest.raises(SystemExit):
        main(["tune", "--help"])
    text = capsys.readouterr().out
    section = text[text.index("settings (--set") :]
    words = re.split(rf"\n  (?={'|'.join([*METHODS, 'all'])}\b)", section)
    (mine,) = [each for each in words if each.startswith(method)]
    expected = {f"{f.name}={f.default}" for f in fields(METHODS[method]) if "low" in f.metadata}
    assert set(mine.split()[1:]) == expected
    assert {"validation_episodes=10000", "final_episodes=10000"} == set(words[-1].split()[1:])


def test_every_setting_is_in_the_configuration():
    for kind in METHODS.values():
        assert {"iterations", "episodes"} <= set(run.settings_of(kind))
