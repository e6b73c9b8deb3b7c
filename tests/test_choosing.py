"""Which point a run returns: against the best of all points on all validation episodes, and against ties."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest

import harness
from harness.cli import main
from harness.engine import rng
from harness.play.evaluation import evaluate
from harness.tuning import choosing, resume, tunable
from harness.tuning.objective import Episodes
from harness.tuning.run import METHODS

QUICK = {"score": {"episodes": 40, "pairs": 5}, "autodiff": {"episodes": 300, "situations": 100, "temperature": 0.02}}


class Line:
    """One number without a policy."""

    names, start = ("x",), np.array([0.30001])
    lower, upper = np.zeros(1), np.ones(1)


def playing(means, noise=0.0, asked=None):
    """An objective: the mean of a point by its index in ``means``, and noise that all points share and some own."""

    def play(ask):
        if asked is not None:
            asked.append((len(ask.points), ask.episodes))
        points = ask.points[:, 0].round(4)
        own = [np.random.default_rng(int(1e4 * x)).normal(size=ask.episodes) for x in points]
        shared = np.random.default_rng(5).normal(size=ask.episodes)
        return np.array([means[x] + noise * (20 * shared + e) for x, e in zip(points, own, strict=True)])

    return play


def history(points, thetas, values):
    return pd.DataFrame({"iteration": np.arange(len(points)), "x": points, "value": values, "theta_x": thetas})


class TestCandidates:
    def test_the_order_in_which_they_win_ties(self):
        table = history([0.31, 0.52, 0.44], [0.30001, 0.4, 0.50004], [1.0, 3.0, 2.0])
        found = choosing.candidates(Line(), table, np.array([0.60002]))
        assert found[:, 0].tolist() == [0.30001, 0.6, 0.5, 0.4, 0.52, 0.44, 0.31]

    def test_equal_points_stand_once_and_the_start_as_it_was_given(self):
        table = history([0.3, 0.3, 0.7], [0.3, 0.3, 0.3], [1.0, 3.0, 2.0])
        assert choosing.candidates(Line(), table, np.array([0.70001]))[:, 0].tolist() == [0.30001, 0.7]

    def test_of_many_the_iterates_fill_half_evenly_and_the_highest_the_rest(self):
        n = 4000
        points, values = np.linspace(0.5, 1, n), np.random.default_rng(0).permutation(n).astype(float)
        found = choosing.candidates(Line(), history(points, np.linspace(0, 0.3, n), values), np.array([0.4]))[:, 0]
        assert len(found) == choosing.POOL
        iterates = found[found < 0.3]
        assert 100 <= len(iterates) <= choosing.POOL // 2
        assert np.abs(np.diff(iterates)).max() < 0.005
        others = set(found[found >= 0.5])
        assert others <= set(points[np.argsort(-values)[: choosing.POOL]].round(4))
        assert len(others) + len(iterates) + 2 == choosing.POOL


class TestChoose:
    @pytest.mark.parametrize("count", [1, 2, 4, 5, 17, 64, 256])
    def test_it_is_the_best_of_all_on_all_episodes(self, count):
        generator = np.random.default_rng(count)
        points = (generator.permutation(9999)[:count, None] + 1) / 10_000
        means = dict(zip(points[:, 0].round(4), generator.normal(size=count) * 10, strict=True))
        asked = []
        chosen = choosing.choose(playing(means, 1.0, asked), points, 6400)
        assert chosen == int(np.argmax(list(means.values())))
        assert asked[-1][1] == 6400
        assert sum(n * episodes for n, episodes in asked) <= 25 * 6400

    @pytest.mark.parametrize("count", [2, 5, 100, 256])
    def test_ties_go_to_the_start_and_then_to_the_first(self, count):
        points = np.arange(1, count + 1)[:, None] / 1000
        flat = dict.fromkeys(points[:, 0].round(4), 2.0)
        assert choosing.choose(playing(flat), points, 500) == 0
        assert choosing.choose(playing({**flat, 0.001: 1.0}), points, 500) == 1
        late = {**flat, points[-1, 0].round(4): 3.0, points[count // 2, 0].round(4): 3.0}
        assert choosing.choose(playing(late), points, 500) == count // 2

    def test_few_episodes_are_all_played_in_every_look(self):
        asked = []
        points = np.arange(1, 101)[:, None] / 1000
        choosing.choose(playing(dict.fromkeys(points[:, 0].round(4), 2.0), 0, asked), points, 7)
        assert {episodes for _, episodes in asked} == {7}


class TestRuns:
    @pytest.mark.parametrize("method", METHODS)
    def test_the_result_is_the_best_of_all_visited_on_episodes_that_none_has_met(self, rocksample, method):
        """Against every candidate on all validation episodes, by evaluate: none is better by more than the noise of a
        look at few."""
        n = 1600
        result = harness.tune(
            rocksample, "belief:0.92", method=method, iterations=6, seed=2, engine="tables", final_episodes=1000,
            validation_episodes=n, **QUICK.get(method, {"episodes": 300}),
        )  # fmt: skip
        ended = np.array(list(result.ended.theta.values()))
        subject = tunable("belief:0.92", rocksample)
        policies = [subject.text(theta) for theta in choosing.candidates(subject, result.history, ended)]
        assert policies[0] == "belief:0.92"
        returns = {policy: self.returns(rocksample, policy, rng.VALIDATION + 2, n) for policy in policies}
        behind = max(returns.values(), key=np.mean) - returns[result.best.policy]
        assert behind.mean() <= 2 * behind.std(ddof=1) / n**0.5
        assert returns[result.best.policy].mean() > returns["belief:0.92"].mean()
        assert returns[result.best.policy].mean() >= np.quantile([row.mean() for row in returns.values()], 0.75)
        visited = pd.concat([result.history["threshold"], result.history["theta_threshold"]]).round(4)
        assert result.best.theta["threshold"] in [*visited, result.ended.theta["threshold"]]
        assert result.moved
        best, start = (
            evaluate(rocksample, scored.policy, episodes=1000, seed=rng.HELD_OUT + 2, engine="tables")
            for scored in (result.best, result.start)
        )
        assert (result.best.score, result.start.score) == (best.score, start.score)
        gap, discounted = best.returns - start.returns, best.discounted - start.discounted
        assert result.gain == pytest.approx(
            (gap.mean(), gap.std(ddof=1) / 1000**0.5, discounted.mean(), discounted.std(ddof=1) / 1000**0.5)
        )
        assert result.gain.mean > 4 * result.gain.sem > 0

    @staticmethod
    def returns(domain, policy, seed, episodes):
        return evaluate(domain, policy, episodes=episodes, seed=seed, engine="tables").returns

    def test_the_papers_ascent_may_end_at_nothing_and_says_so(self, tmp_path, capsys):
        """From belief:0.92 six iterations end at belief:1.0, where nothing is ever believed."""
        arguments = ["--set", "episodes=1000", "--set", "iterations=6", "--engine", "tables", "--out", str(tmp_path)]
        assert main(["tune", "rocksample-7x8", "--policy", "belief:0.92", *arguments]) == 0
        out = capsys.readouterr().out
        result = json.loads((tmp_path / "result.json").read_text())
        history = pd.read_csv(tmp_path / "history.csv")
        assert result["ended"]["policy"] == "belief:1.0"
        assert result["ended"]["fresh"]["mean"] == 0
        assert result["fresh"]["mean"] > result["start"]["fresh"]["mean"] + 1
        last = history.iloc[-1]
        assert min(1, last["theta_threshold"] + last["velocity_threshold"]) == 1  # the history is the method's own
        gain = result["gain"]
        assert result["fresh"]["mean"] - result["start"]["fresh"]["mean"] == pytest.approx(gain["mean"])
        assert f"more than the start: {gain['mean']:+.2f} ± {gain['sem']:.2f}" in out
        assert "the end of the method there   return 0.00" in out

    def test_where_the_start_was_best_it_says_so(self, capsys):
        """On a plateau all play alike, so all is tied, and ties go to the start."""
        arguments = ["--policy", "belief:0.7", "--set", "episodes=100", "--method", "lines", "--engine", "tables"]
        arguments += ["--set", "coarse=1", "--set", "resolution=0.5"]
        small = [f"--set={name}_episodes=200" for name in ("validation", "final")]
        assert main(["tune", "rocksample-7x8", *arguments, *small, "--measure", "discounted"]) == 0
        out = capsys.readouterr().out
        assert "  belief:0.7\n" in out
        assert "the start was the best" in out
        assert "more than the start" not in out

    def test_the_measure_chooses(self, rocksample):
        """Undiscounted return rises above the plateau of belief, discounted return falls."""
        found = {
            measure: harness.tune(
                rocksample, "belief:0.85", method="cmaes", measure=measure, iterations=3, episodes=500, engine="tables",
                validation_episodes=2000, final_episodes=2000,
            )
            for measure in ("return", "discounted")
        }  # fmt: skip
        assert found["return"].best.theta["threshold"] > 0.95
        assert found["return"].gain.discounted_mean < 0 < found["return"].gain.mean
        assert not found["discounted"].moved
        assert found["discounted"].gain == (0, 0, 0, 0)

    def test_shaping_does_not_choose(self, monkeypatch, rocksample, bordercross):
        """Validation plays the true reward, whatever the tuning has seen."""
        seen = set()
        plain = Episodes.__call__

        def play(self, ask):
            seen.add((self.range, self.domain.shaping))
            return plain(self, ask)

        monkeypatch.setattr(Episodes, "__call__", play)
        shaped = bordercross.shaped("paper")

        class Waits:
            def __init__(self, share):
                self.steps = round(10 * share)

            def reset(self, batch):
                pass

            def act(self, batch):
                return np.full(batch.size, 0 if batch.step < self.steps else 4)

        class Subject(Line):
            def policy(self, theta):
                return Waits(theta[0])

            def text(self, theta):
                return f"wait {theta[0]}"

        harness.tune(shaped, Subject(), iterations=2, episodes=3, validation_episodes=3, final_episodes=3)
        assert seen == {(rng.TRAINING, "paper"), (rng.VALIDATION, "none")}

    def test_stopped_while_choosing_and_resumed_it_is_the_same(self, rocksample, tmp_path, monkeypatch):
        options = {"iterations": 3, "episodes": 100, "validation_episodes": 100, "final_episodes": 50}
        whole = harness.tune(rocksample, "belief:0.93", out=tmp_path / "whole", engine="tables", **options)
        plain = Episodes.__call__

        def stop(self, ask):
            if self.range == rng.VALIDATION:
                raise KeyboardInterrupt
            return plain(self, ask)

        monkeypatch.setattr(Episodes, "__call__", stop)
        with pytest.raises(KeyboardInterrupt):
            harness.tune(rocksample, "belief:0.93", out=tmp_path / "cut", engine="tables", **options)
        monkeypatch.undo()
        again = resume(tmp_path / "cut", engine="tables")
        assert (again.best, again.start, again.ended, again.gain) == (whole.best, whole.start, whole.ended, whole.gain)
        for name in ("config.json", "history.csv", "result.json"):
            assert (tmp_path / "cut" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
