"""The report: what it recognises, what it shows, and that nothing in its inputs can become markup."""

from __future__ import annotations

import dataclasses
import datetime
import html
import importlib.metadata
import io
import json
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import harness
from harness import policy, registry
from harness.cli import main
from harness.model import archive, domain
from harness.play.evaluation import evaluate, simulate
from harness.policy.program import ProgramPolicy, stored_program
from harness.policy.simple import RandomPolicy
from harness.program import parse, words_of
from harness.report import bars, charts, inputs, page, programs
from harness.report.replays import Domains, Wanted, episode, replays
from harness.score import rendering
from harness.show.replay import replay
from tests.conftest import size

HOSTILE = "</script><script>window.hacked = 1</script><img src=x onerror='window.hacked = 1'>&\"\u2028"


class Reader(HTMLParser):
    """Elements with their attributes, the text of cells row by row, and the JSON for the scripts."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.rows, self.data, self.text = [], [], [], ""
        self._inside = None
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")
        self._inside = tag

    def handle_endtag(self, tag):
        self._inside = None

    def handle_data(self, data):
        if self._inside in ("td", "th"):
            self.rows[-1][-1] += data
        if self._inside == "script" and self.tags[-1][1].get("type") == "application/json":
            self.data.append(json.loads(data))
        elif self._inside not in ("script", "style"):
            self.text += data

    def count(self, tag, **attributes):
        return sum(name == tag and attributes.items() <= found.items() for name, found in self.tags)


def write(tmp_path, *sources, **options):
    path = harness.write_report(sources, tmp_path / "out", **options)
    assert path == tmp_path / "out" / "index.html"
    return Reader(path.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def whole(report_inputs, tmp_path_factory):
    """A page of everything."""
    return write(tmp_path_factory.mktemp("whole"), *report_inputs.values())


@pytest.fixture(scope="module")
def tuned_program(tmp_path_factory):
    """A program that samples rock 4 whatever is believed of it, until it is tuned."""
    folder = tmp_path_factory.mktemp("tuned")
    text = "check(4)\nif(belief(4) > 0.02) {\n" + "    right()\n" * 6 + "    sample()\n}\n"
    text += "if(belief(5) > 0.5) check(1)\n" + "right()\n" * 7
    episodes = {"episodes": 60, "validation_episodes": 200, "final_episodes": 200}
    return folder, harness.tune("rocksample-7x8", text, method="lines", out=folder, engine="tables", **episodes)


class TestInputs:
    def test_each_kind_is_recognised(self, report_inputs):
        kinds = {name: [type(each) for each in inputs.read(path)] for name, path in report_inputs.items()}
        assert kinds.pop("run") == [inputs.Run]
        assert kinds.pop("runs") == [inputs.Runs]
        assert kinds.pop("tuning") == [inputs.Tuning]
        assert kinds.pop("sweep") == [inputs.Sweep]
        assert set(map(tuple, kinds.values())) == {(inputs.Table,)}
        assert isinstance(inputs.read(report_inputs["sweep"] / "sweep.csv")[0], inputs.Sweep)

    def test_the_contents_lead_to_every_section(self, whole, report_inputs):
        links = [a["href"] for tag, a in whole.tags if tag == "a"]
        sections = ["#" + a["id"] for tag, a in whole.tags if tag == "section"]
        assert links == sections
        assert len(links) == len(report_inputs)

    def test_csv_and_json_make_the_same_table(self, report_inputs, tmp_path):
        pages = [write(tmp_path, report_inputs[f"rocks.{ending}"]) for ending in ("csv", "json")]
        assert pages[0].rows == pages[1].rows
        assert pages[0].data == pages[1].data

    def test_the_kind_is_in_the_content_not_in_the_name(self, report_inputs, tmp_path):
        shutil.copy(report_inputs["rocks.json"], tmp_path / "table.txt")
        assert write(tmp_path, tmp_path / "table.txt").count("table", **{"class": "sortable"}) == 1

    def test_a_file_of_two_domains_is_a_section_of_both_and_two(self, report_inputs, tmp_path):
        both = pd.concat([pd.read_csv(report_inputs[name]) for name in ("rocks.csv", "border.csv")])
        both.to_csv(tmp_path / "both.csv", index=False)
        assert write(tmp_path, tmp_path / "both.csv").count("section") == 3
        page = (tmp_path / "out" / "index.html").read_text(encoding="utf-8")
        (share,) = harness.coverage(both).set_index("policy").loc[["sarsop"], "share_mean"]
        assert f"<td>{share:.3f} [" in page
        pd.concat([both, both.iloc[:1]]).to_csv(tmp_path / "both.csv", index=False)
        write(tmp_path, tmp_path / "both.csv")
        page = (tmp_path / "out" / "index.html").read_text(encoding="utf-8")
        assert "No figures over the domains: rocksample-7x8 has two rows named belief:0.84" in page

    @pytest.mark.parametrize(
        ("content", "words"),
        [
            (None, "no such file or folder"),
            (b"", "expected a comparison table"),
            (b"PK\x03\x04\xff\xfe", "no text file"),
            (b"a,b\n1,2\n", "nothing to report on; expected a comparison table"),
            (b"a,b\n", "no rows"),
            (b'{"a": 1}', "nothing to report on"),
            (b"[]", "nothing to report on"),
            (b'[{"domain": ', "not readable as JSON"),
            (b'a,b\n"1,2\n', "expected a comparison table"),
        ],
    )
    def test_anything_else_is_one_sentence(self, tmp_path, capsys, content, words, monkeypatch):
        monkeypatch.chdir(tmp_path)  # a sentence has room for a short path only
        path = Path("input")
        if content is not None:
            path.write_bytes(content)
        self.refused(capsys, tmp_path, path, str(path), words)

    @staticmethod
    def refused(capsys, tmp_path, path, *words):
        assert main(["report", str(path), "--out", str(tmp_path / "out")]) == 2
        captured = capsys.readouterr()
        assert captured.out == ""
        assert captured.err.startswith("harness: ")
        assert captured.err.count("\n") == 1
        for each in words:
            assert each in captured.err
        assert not (tmp_path / "out").exists()

    def test_an_empty_folder_is_one_sentence(self, tmp_path, capsys):
        (tmp_path / "empty").mkdir()
        self.refused(capsys, tmp_path, tmp_path / "empty", "nothing to report on")

    def test_a_word_for_a_number_is_one_sentence(self, report_inputs, tmp_path, capsys):
        table = pd.read_csv(report_inputs["rocks.csv"], dtype=str)
        table.loc[0, "mean"] = "many"
        table.to_csv(tmp_path / "t.csv", index=False)
        self.refused(capsys, tmp_path, tmp_path / "t.csv", "a number was expected", "many")

    @pytest.mark.parametrize(
        ("kind", "name", "content"),
        [
            ("run", "best.json", "{"),
            ("run", "best.json", '{"program": []}'),
            ("run", "config.json", "[]"),
            ("run", "history.csv", "a,b\n1,2\n"),
            ("run", "history.csv", "generation,best,test,test_sem\n1,x,3,4\n"),
            ("runs", "seed-1/config.json", '{"domain": "rocksample-7x8"}'),
            ("tuning", "result.json", "[1]"),
            ("tuning", "config.json", '{"run": {}}'),
        ],
    )
    def test_a_damaged_run_is_one_sentence(self, report_inputs, tmp_path, capsys, kind, name, content):
        shutil.copytree(report_inputs[kind], tmp_path / "run")
        (tmp_path / "run" / name).write_text(content)
        self.refused(capsys, tmp_path, tmp_path / "run", str(tmp_path / "run" / name))

    @pytest.mark.parametrize(
        ("kind", "name"),
        [
            ("rocks.json", ""),
            ("run", "best.json"),
            ("run", "config.json"),
            ("tuning", "result.json"),
            ("tuning", "config.json"),
            ("rocks.csv", ""),
            ("run", "history.csv"),
            ("run", "finalists.csv"),
            ("tuning", "history.csv"),
            ("sweep", "sweep.csv"),
        ],
    )
    def test_whatever_is_wrong_in_a_file_there_is_no_traceback(self, report_inputs, tmp_path, kind, name):
        """Every value in turn is left out, nothing, a word, a number or an object; then the file is cut short.

        In small a third of these.
        """
        whole = report_inputs[kind]
        copy = tmp_path / "copy"
        shutil.copytree(whole, copy) if whole.is_dir() else shutil.copy(whole, copy)
        path = copy / name if name else copy
        content = path.read_text()
        spoilt = list(
            spoil_json(content) if path.name.endswith(".json") or kind.endswith(".json") else spoil_csv(content)
        )
        refused = 0
        for each in [*spoilt[:: size(3, 1)], content[: len(content) // 2]]:
            path.write_text(each)
            try:
                harness.write_report(copy, tmp_path / "out", episodes=0)
            except harness.HarnessError as error:
                assert str(path) in str(error) or str(copy) in str(error)  # noqa: PT017  (some are no error)
                refused += 1
        assert 0 < refused <= len(spoilt) + 1

    @pytest.mark.parametrize("options", [{"episodes": -1}, {"seed": -1}, {"seed": 2**64}, {"domains": ["no-such"]}])
    def test_wrong_arguments(self, report_inputs, tmp_path, options):
        with pytest.raises(harness.HarnessError):
            harness.write_report([report_inputs["rocks.csv"]], tmp_path, **options)

    def test_nothing_to_report_on(self, tmp_path):
        with pytest.raises(harness.HarnessError, match="something to report on"):
            harness.write_report([], tmp_path)


class TestPage:
    def test_the_table_shows_what_compare_prints(self, report_inputs, tmp_path):
        (table,) = inputs.read(report_inputs["rocks.json"])
        rows = write(tmp_path, report_inputs["rocks.csv"]).rows[:5]  # those of the numbers of the bars come after
        assert rows == [list(rendering.shown(table.frame)), *rendering.shown(table.frame).values.tolist()]
        assert rows[2][3:5] == [rendering.shown(table.frame)["of optimum"][1], "21.39"]
        assert rows[4][0] == "mdp (upper bound)"

    @pytest.mark.parametrize("ending", ["csv", "json"])
    def test_differences_from_one_policy_stand_below(self, tmp_path, ending):
        table = harness.compare("rocksample-7x8", ["belief", "exit"], against="sarsop", episodes=20, engine="tables")
        file = tmp_path / f"paired.{ending}"
        file.write_text(harness.render(table, ending), encoding="utf-8")
        rows = write(tmp_path / "page", file).rows
        expected = rendering.differences(table)
        assert len(expected) == 2
        assert rows[-3:] == [list(expected), *expected.values.tolist()]
        spoilt = table.assign(p_value="low")
        file.write_text(harness.render(spoilt, ending), encoding="utf-8")
        with pytest.raises(harness.HarnessError, match="a number was expected"):
            harness.write_report([file], tmp_path / "other")

    def test_bounds_are_marked_and_missing_values_have_no_key(self, report_inputs, tmp_path):
        found = write(tmp_path, report_inputs["rocks.csv"])
        assert found.count("tr", **{"class": "bound"}) == 1
        keys = [a.get("data-key") for tag, a in found.tags if tag in ("td", "th") and a.get("scope") != "col"]
        assert keys[:2] == ["belief:0.84", keys[1]]
        assert float(keys[1]) == pytest.approx(inputs.read(report_inputs["rocks.csv"])[0].frame["mean"][0])
        assert keys[4] is None  # nothing published for belief
        assert keys[8 + 4] == "21.39"

    def test_the_winner_stands_with_its_three_figures(self, report_inputs, tmp_path):
        found = write(tmp_path, report_inputs["run"])
        best = json.loads((report_inputs["run"] / "best.json").read_text())
        assert "\n".join(best["program"]) in found.text
        assert f"{best['score']['mean']:.2f} ± {best['score']['sem']:.2f} (50 episodes)" in found.text
        assert f"{best['validation']:.2f} (50 other episodes)" in found.text
        assert f"{best['fitness']:.2f} (chosen by these 10 episodes: lucky)" in found.text
        for words in (best["git"] or "", best["versions"]["numba"], "rocksample-feedback", "population 10"):
            assert words in found.text

    @pytest.mark.parametrize("seed", [0, 1])
    def test_of_many_runs_the_validation_chooses(self, report_inputs, tmp_path, seed):
        """And not the score on fresh episodes, which would no longer be one then."""
        shutil.copytree(report_inputs["runs"], tmp_path / "runs")
        for k in (0, 1):
            path = tmp_path / "runs" / f"seed-{k}" / "best.json"
            best = json.loads(path.read_text())
            best["validation"], best["score"]["mean"] = (12.0, 8.0) if k == seed else (11.0, 15.0)
            path.write_text(json.dumps(best))
        found = write(tmp_path, tmp_path / "runs")
        assert f"Best program: of seed-{seed}" in found.text
        assert found.data[-1]["policies"][0]["name"] == f"best program of seed-{seed}"
        curve = pd.read_csv(report_inputs["runs"] / "curve.csv")
        (_, fresh) = found.data[0]["series"]
        np.testing.assert_allclose([fresh["low"], fresh["y"], fresh["high"]], curve[["q25", "q50", "q75"]].T, rtol=1e-5)

    def test_a_learning_curve_is_the_history(self, report_inputs, tmp_path):
        history = pd.read_csv(report_inputs["run"] / "history.csv")
        selected, fresh = write(tmp_path, report_inputs["run"]).data[0]["series"]
        np.testing.assert_allclose(selected["y"], history["best"], rtol=1e-5)
        np.testing.assert_allclose(fresh["y"], history["test"], rtol=1e-5)
        np.testing.assert_allclose(fresh["high"], history["test"] + 1.96 * history["test_sem"], atol=1e-3)

    def test_what_flattens_a_curve_is_shown_and_so_is_the_rest(self, report_inputs, tmp_path):
        shutil.copytree(report_inputs["run"], tmp_path / "run")
        history = pd.read_csv(tmp_path / "run" / "history.csv")
        longer = pd.concat([history.iloc[:1]] * 40, ignore_index=True)
        longer["generation"], longer["test"], longer["best"] = (
            range(40),
            np.linspace(9, 10, 40),
            np.linspace(10, 11, 40),
        )
        longer.loc[:2, ["best", "test"]] = -500.0
        longer.to_csv(tmp_path / "run" / "history.csv", index=False)
        whole, upper = write(tmp_path, tmp_path / "run").data[:2]
        assert whole["y"]["bottom"] is None
        assert -500 < upper["y"]["bottom"] < 9
        assert whole["series"] == upper["series"]

    def test_a_run_under_way_is_shown_as_far_as_it_is(self, report_inputs, tmp_path):
        shutil.copytree(report_inputs["run"], tmp_path / "run")
        for name in ("best.json", "finalists.csv"):
            (tmp_path / "run" / name).unlink()
        history = tmp_path / "run" / "history.csv"
        history.write_text(history.read_text()[:-5])  # the last line is half written
        found = write(tmp_path, tmp_path / "run")
        assert "run has not finished: 3 of 4 generations" in found.text
        assert len(found.data[0]["x"]["values"]) == 3
        assert found.count("div", **{"class": "player"}) == 1

    def test_a_run_that_has_only_begun(self, report_inputs, tmp_path):
        for kind in ("run", "tuning"):
            (tmp_path / kind).mkdir()
            shutil.copy(report_inputs[kind] / "config.json", tmp_path / kind)
        shutil.copy(report_inputs["run"] / "grammar.bnf", tmp_path / "run")
        found = write(tmp_path, tmp_path / "run", tmp_path / "tuning")
        assert found.text.count("has not finished") == 2
        assert found.data == []

    def test_every_chart_has_its_numbers_as_a_table(self, whole):
        drawn = [record for record in whole.data if "series" in record]
        assert len(drawn) == whole.count("figure", **{"class": "chart"}) == 7
        rows = {tuple(row) for row in whole.rows}
        for record in drawn:
            first = next(x for x in record["series"][0]["y"] if x is not None)
            x = record["x"]["values"][record["series"][0]["y"].index(first)]
            assert any(row[:1] == (f"{x:g}",) and f"{first:.6g}" in row for row in rows)

    def test_the_same_inputs_give_the_same_bytes(self, report_inputs, tmp_path):
        made = datetime.date(2026, 3, 1)
        texts = {
            harness.write_report(list(report_inputs.values()), tmp_path / name, made=made).read_bytes()
            for name in ("a", "b")
        }
        assert len(texts) == 1

    def test_when_and_by_what_it_was_made(self, report_inputs, tmp_path, monkeypatch):
        def told(**options):
            found = write(tmp_path, report_inputs["rocks.csv"], episodes=0, **options)
            assert found.count("time") == 1
            return re.search(r"Made on (\S+) by pomdp-harness (\S+)", found.text).groups()

        version = importlib.metadata.version("pomdp-harness")
        assert told(made=datetime.date(2001, 2, 3)) == ("2001-02-03", version)
        monkeypatch.setenv("SOURCE_DATE_EPOCH", "86400")
        assert told() == ("1970-01-02", version)
        for wrong in ("soon", "", "9" * 30):
            monkeypatch.setenv("SOURCE_DATE_EPOCH", wrong)
            with pytest.raises(harness.HarnessError, match="SOURCE_DATE_EPOCH must be seconds since 1970"):
                told()
        monkeypatch.delenv("SOURCE_DATE_EPOCH")
        before = datetime.datetime.now(datetime.timezone.utc).date()
        assert before.isoformat() <= told()[0] <= datetime.datetime.now(datetime.timezone.utc).date().isoformat()

    def test_bars_are_the_tables_means_with_their_intervals(self, report_inputs, tmp_path):
        frame = pd.read_csv(report_inputs["rocks.csv"])
        found = write(tmp_path, report_inputs["rocks.csv"], episodes=0)
        for record, prefix in zip(found.data, ("", "discounted_"), strict=True):
            drawn = pd.DataFrame(record["bars"])
            assert drawn["name"].tolist() == ["belief:0.84", "sarsop", "exit", "mdp (upper bound)"]
            assert drawn["bound"].tolist() == [False, False, False, True]
            np.testing.assert_allclose(drawn["y"], frame[f"{prefix}mean"], rtol=1e-5)
            half = 1.959964 * frame[f"{prefix}sem"][:3]
            np.testing.assert_allclose(drawn["low"][:3], frame[f"{prefix}mean"][:3] - half, rtol=1e-5)
            np.testing.assert_allclose(drawn["high"][:3], frame[f"{prefix}mean"][:3] + half, rtol=1e-5)
            assert pd.isna(drawn["low"][3])
        assert ["exit", "10", "10", "10"] in found.rows  # the numbers of the chart
        assert ["mdp (upper bound)", f"{frame['mean'][3]:.6g}", "", ""] in found.rows

    def test_an_axis_of_bars(self):
        def ends(*values):
            return bars.scale(pd.DataFrame({"y": values}, dtype=float))

        assert ends(10, 20) == (0, pytest.approx(20.6))
        assert ends(-10, np.nan) == (pytest.approx(-10.3), 0)
        assert ends(-10, 20) == (pytest.approx(-10.9), pytest.approx(20.9))
        assert ends(-1000, 20) == (pytest.approx(-5.75), pytest.approx(20.75))  # the loss runs off the page
        assert ends(0, 0) == (0, 1)

    def test_a_program_is_shown_line_by_line(self, report_inputs, tmp_path):
        text = (report_inputs["run"] / "best.txt").read_text()
        path = harness.write_report(report_inputs["run"], tmp_path, episodes=0)
        numbered = re.findall(r'<pre class="numbered".*?</pre>', path.read_text(encoding="utf-8"), re.DOTALL)
        lines = re.findall(r'<span class="line">(.*?)</span>', numbered[0])
        assert [html.unescape(line) for line in lines] == text.splitlines()

    def test_how_an_evolved_program_came_about(self, report_inputs, tmp_path):
        shutil.copytree(report_inputs["run"], tmp_path / "run")
        best = json.loads((tmp_path / "run" / "best.json").read_text())
        best["program"] = ["check(1)", "up()", "right()"]
        (tmp_path / "run" / "best.json").write_text(json.dumps(best))
        programs = {0: ["up()"], 2: ["up()", "right()"], 5: ["down()", "right()"]}
        kept = [{"generation": g, "test": 1.5 * g, "program": lines} for g, lines in programs.items()]
        (tmp_path / "run" / "improvements.json").write_text(json.dumps(kept))
        found = write(tmp_path, tmp_path / "run", episodes=0)
        for words in (
            "Generation 0: 0.00Copyup()",
            "Generation 2: 3.00 (+3.00), 0 lines gone, 1 new  up()\n+ right()\n",
            "Generation 5: 7.50 (+4.50), 1 line gone, 1 new- up()\n+ down()\n  right()\n",
            "The winner: 1 line gone, 2 new- down()\n+ check(1)\n+ up()\n  right()\n",
        ):
            assert words in found.text

    def test_of_many_improvements_the_largest_are_shown(self, report_inputs, tmp_path):
        shutil.copytree(report_inputs["run"], tmp_path / "run")
        kept = [{"generation": g, "test": float(g * g), "program": ["up()"] * (g + 1)} for g in range(20)]
        (tmp_path / "run" / "improvements.json").write_text(json.dumps(kept))
        found = write(tmp_path, tmp_path / "run", episodes=0)
        assert re.findall(r"Generation (\d+): ", found.text) == [str(g) for g in (0, *range(8, 20))]
        assert "the 12 largest of 19" in found.text

    def test_a_program_tuned_at_the_end_has_no_fitness(self, report_inputs, tmp_path):
        shutil.copytree(report_inputs["runs"], tmp_path / "runs")
        path = tmp_path / "runs" / "seed-0" / "best.json"
        path.write_text(json.dumps({**json.loads(path.read_text()), "fitness": None, "validation": 1e6}))
        found = write(tmp_path, tmp_path / "runs", episodes=0)
        assert "fitness among the finalists" in found.text
        assert "fitness in the last generation" not in found.text[: found.text.index("Program of seed-1")]
        assert ["0", ""] in [row[:2] for row in found.rows]

    def test_what_tuning_changed_in_a_program(self, tuned_program, tmp_path):
        folder, result = tuned_program
        found = write(tmp_path, folder)
        assert "Tuning of a program on rocksample-7x8" in found.text
        now = result.best.theta["c1"]
        assert now > 0.1
        assert f"- if(belief(4) > 0.02) {{\n+ if(belief(4) > {now:g}) {{\n" in found.text
        assert ["c1", "0.02", f"{now:g}", f"{now - 0.02:+g}"] in found.rows
        assert ["c2", "0.5", "0.5", "none"] in found.rows
        assert result.best.policy.rstrip("\n") in found.text

    def test_nothing_is_loaded_from_anywhere(self, report_inputs, tmp_path):
        found = write(tmp_path, *report_inputs.values())
        addresses = [a[name] for _, a in found.tags for name in ("src", "href", "action", "data") if a.get(name)]
        assert all(address.startswith("#") or address == "data:," for address in addresses)
        text = (tmp_path / "out" / "index.html").read_text(encoding="utf-8")
        assert re.findall(r"https?://[^\s\"']+", text) == ["http://www.w3.org/2000/svg"]  # the name of a namespace
        policy_text = next(a["content"] for tag, a in found.tags if a.get("http-equiv") == "Content-Security-Policy")
        assert policy_text.startswith("default-src 'none';")
        assert "unsafe" not in policy_text

    def test_every_static_file_is_used(self):
        assert {path.name for path in page.STATIC.iterdir()} == {"page.html", "report.css", *page.SCRIPTS}

    def test_markup_in_the_inputs_stays_text(self, report_inputs, rocksample, tmp_path):
        table = pd.DataFrame(json.loads(report_inputs["rocks.json"].read_text()))
        table.loc[0, "policy"] = HOSTILE
        table["domain"] = HOSTILE
        table["engine"] = HOSTILE
        (tmp_path / f"{HOSTILE[-6:-4]}.json").write_text(table.to_json(orient="records"))
        shutil.copytree(report_inputs["run"], tmp_path / "run<b>")
        best = json.loads((tmp_path / "run<b>" / "best.json").read_text())
        best["program"] = [HOSTILE]
        (tmp_path / "run<b>" / "best.json").write_text(json.dumps(best))
        improvement = {"generation": 0, "test": 1.0, "program": ["up()"]}
        (tmp_path / "run<b>" / "improvements.json").write_text(json.dumps([improvement]))
        shutil.copytree(report_inputs["tuning"], tmp_path / "tuning")
        hostile_tuning(tmp_path / "tuning")
        config = json.loads((tmp_path / "run<b>" / "config.json").read_text())
        config |= {"grammar": HOSTILE, "git": HOSTILE, "versions": {HOSTILE: HOSTILE}}
        del config["hash"]  # hostile, not damaged: under a hash that is right again
        config["hash"] = archive.digest({}, [config, (tmp_path / "run<b>" / "grammar.bnf").read_text()])
        (tmp_path / "run<b>" / "config.json").write_text(json.dumps(config))
        sweep = pd.read_csv(report_inputs["sweep"] / "sweep.csv").rename(columns={"threshold": HOSTILE})
        sweep.to_csv(tmp_path / "s.csv", index=False)
        own = dataclasses.replace(rocksample, name="own", title=HOSTILE, layout={"kind": HOSTILE})
        own = dataclasses.replace(own, features=tuple((HOSTILE, k, x) for _, k, x in own.features))
        played = harness.compare(own, ["random"], episodes=5, engine="tables")
        (tmp_path / "own.csv").write_text(harness.render(played, "csv"))
        tables = [next(tmp_path.glob("*.json")), tmp_path / "own.csv", tmp_path / "s.csv", tmp_path / "tuning"]
        found = write(tmp_path, *tables, tmp_path / "run<b>", domains=[own])
        (features,) = [each["domain"]["features"] for each in found.data if "domain" in each]
        assert features == [HOSTILE] * 8
        assert f"{HOSTILE} (no unit)" in [each["x"]["label"] for each in found.data if "x" in each]
        assert HOSTILE in [bar["name"] for each in found.data if "bars" in each for bar in each["bars"]]
        assert found.count("ins") == found.count("del") == 2  # the diff's own: of the program, and of the tuned one
        assert found.text.count(f"- {HOSTILE}") == 1
        assert found.count("script", type="module") == 1
        assert found.count("script") == 1 + len(found.data)
        assert found.count("img") == found.count("b") == 0
        assert found.rows[1][0] == HOSTILE
        assert found.text.count(HOSTILE) >= 7


def hostile_tuning(folder):
    """A run that says it tuned a program; start, result and numbers are markup."""
    config = json.loads((folder / "config.json").read_text())
    config["run"]["policy"] = HOSTILE + "\n"
    config["hash"] = archive.digest({}, config["run"])
    (folder / "config.json").write_text(json.dumps(config))
    result = json.loads((folder / "result.json").read_text())
    result["policy"] = "up()" + HOSTILE + "\n"
    for place in (result, result["start"]):
        place["theta"] = {HOSTILE: 0.5}
    (folder / "result.json").write_text(json.dumps(result))


class TestReplays:
    @pytest.mark.parametrize(
        ("name", "spec"),
        [
            ("rocksample-7x8", "belief:0.84"),
            ("rocksample-7x8", "accuracy:0.93"),  # does not look at the belief, which is shown all the same
            ("rocksample-7x8", "random"),
            ("rocksample-7x8", "sarsop"),
            ("bordercross-7x8-random", "random-legal"),
            ("bordercross-7x8", "sarsop"),
        ],
    )
    def test_they_are_the_episodes_that_evaluate_scores(self, name, spec):
        known = harness.load(name)
        result = evaluate(known, spec, episodes=5, seed=7, engine="tables")
        wanted = Wanted(spec, name, 7, 50, spec)
        data, missing = replays([wanted], Domains(), 5)
        assert missing == []
        played = data["policies"][0]["episodes"]
        assert [sum(each["reward"]) for each in played] == result.returns.tolist()
        assert [len(each["action"]) - 1 for each in played] == result.steps.tolist()
        assert [each["terminated"] for each in played] == result.terminated.tolist()

    @pytest.mark.parametrize("name", ["rocksample-7x8", "bordercross-7x8-random"])
    def test_step_by_step_they_are_those_of_a_batch(self, name):
        """One episode at a time, and the same ones side by side: every action, reading, reward, position and belief."""
        known = harness.load(name)
        made = policy.make("sarsop", known)[1]
        one = [unpacked(episode(known, policy.make("sarsop", known)[1], 3, k, 50)) for k in range(4)]
        for t, record in enumerate(simulate(known, made, "tables", 3, 0, 4, 50)):
            for k, columns in enumerate(one):
                if not record.active[k]:
                    assert len(columns["action"]) <= t
                    continue
                assert columns["action"][t] == (-1 if record.actions is None else record.actions[k])
                read = known.observations[record.batch.observation[k]] if record.batch.observation[k] >= 0 else "none"
                assert ("none" if columns["reading"][t] < 0 else known.observations[columns["reading"][t]]) == read
                assert columns["reward"][t] == (record.rewards[k] if record.actions is not None else 0)
                assert columns["visible"][t] == known.visible_values[record.batch.visible[k]].tolist()
                np.testing.assert_allclose(columns["beliefs"][t], record.batch.features[k], atol=0.0006)
        assert max(len(columns["action"]) for columns in one) == t + 1

    def test_the_way_out_by_hand(self, rocksample):
        columns = unpacked(episode(rocksample, policy.make("exit", rocksample)[1], 0, 0, 50))
        assert [rocksample.actions[a] for a in columns["action"][1:]] == ["right()"] * 7
        assert columns["visible"][:7] == [[x, 4] for x in range(1, 8)]
        assert columns["reward"] == [0] * 7 + [10]
        assert columns["ending"] == "reached a terminal state"
        assert columns["beliefs"][0].tolist() == [0.5] * 8

    def test_tables_are_replayed_with_their_own_seed(self, report_inputs, tmp_path):
        found = write(tmp_path, report_inputs["rocks.csv"], episodes=2)
        record = found.data[-1]
        assert [each["name"] for each in record["policies"]] == ["belief:0.84", "sarsop", "exit"]
        returns = evaluate("rocksample-7x8", "sarsop", episodes=2, seed=4, engine="tables").returns
        assert [sum(each["reward"]) for each in record["policies"][1]["episodes"]] == returns.tolist()
        table = pd.read_csv(report_inputs["rocks.csv"])[:3].assign(seed=2**60 + 1)  # more digits than a float has
        table.to_csv(tmp_path / "t.csv", index=False)
        assert write(tmp_path, tmp_path / "t.csv").data[-1]["policies"][0]["seed"] == str(2**60 + 1)
        other = write(tmp_path, report_inputs["rocks.csv"], episodes=2, seed=9).data[-1]
        assert {each["seed"] for each in other["policies"]} == {"9"}
        assert other["policies"][1] != record["policies"][1]

    def test_the_winners_replay_is_its_program(self, report_inputs, tmp_path):
        (played,) = write(tmp_path, report_inputs["run"]).data[-1]["policies"]
        spec = f"program:{report_inputs['run'] / 'best.txt'}"
        returns = evaluate("rocksample-7x8", spec, episodes=3, engine="tables").returns
        assert [sum(each["reward"]) for each in played["episodes"]] == returns.tolist()

    def test_a_tuned_program_is_replayed_as_a_program(self, tuned_program, tmp_path):
        folder, result = tuned_program
        found = write(tmp_path, folder)
        assert "No replay" not in found.text
        played = found.data[-1]["policies"]
        assert [each["name"] for each in played] == ["the result", "the start"]
        for each, place in zip(played, (result.best, result.start), strict=True):
            assert each["program"] == place.policy.splitlines()
            (tmp_path / "p.txt").write_text(place.policy)
            returns = evaluate("rocksample-7x8", f"program:{tmp_path / 'p.txt'}", episodes=3, engine="tables").returns
            assert [sum(episode["reward"]) for episode in each["episodes"]] == returns.tolist()

    def test_a_tuned_heuristic_is_replayed_beside_its_start(self, report_inputs, tmp_path):
        shutil.copytree(report_inputs["tuning"], tmp_path / "tuning")
        for best, names in (
            ("belief:0.7", ["the result, belief:0.7", "the start, belief:0.92"]),
            ("belief:0.92", ["the start, belief:0.92"]),
        ):
            path = tmp_path / "tuning" / "result.json"
            path.write_text(json.dumps({**json.loads(path.read_text()), "policy": best}))
            played = write(tmp_path, tmp_path / "tuning").data[-1]["policies"]
            assert [each["name"] for each in played] == names

    def test_the_line_that_every_action_came_from(self, rocksample):
        """By hand: rock 3 is asked about twice, then the robot goes right until it is out."""
        text = "check(3) if(x() == 1) { check(3) right() } else up() while(x() < 9) right()"
        made = ProgramPolicy(parse(text, words_of(rocksample)))
        columns = episode(rocksample, made, 0, 0, 50)
        lines = made.program.text.splitlines()
        told = ["", *(lines[line].strip() for line in columns["line"][1:])]
        assert columns["line"][0] == -1
        assert told == ["", "check(3)", "check(3)", "right()", *["while(x() < 9) right()"] * 6]

    @pytest.mark.parametrize("word", ["ge", "ge-feedback"])
    def test_a_line_has_the_action_that_was_taken(self, rocksample, word):
        made = policy.make(word, rocksample)[1]
        lines = made.program.text.splitlines()
        seen = set()
        for k in range(5):
            columns = episode(rocksample, made, 1, k, 50)
            assert len(columns["line"]) == len(columns["action"])
            for line, action in list(zip(columns["line"], columns["action"], strict=True))[1:]:
                assert lines[line].endswith(rocksample.actions[action])
            seen |= set(columns["line"])
        assert len(seen) > 10
        assert "line" not in episode(rocksample, policy.make("sarsop", rocksample)[1], 1, 0, 50)

    def test_what_was_true_is_what_the_rewards_say(self, rocksample):
        """A rock that pays was good, and is bad from then on; one that costs was bad."""
        made = policy.make("accuracy:0.5", rocksample)[1]  # samples bad ones too
        rocks = {tuple(place): i for i, place in enumerate(rocksample.layout["rocks"])}
        paid = set()
        for k in range(20):
            columns = episode(rocksample, made, 2, k, 50)
            good = [word == "good" for word in columns["hidden"]["start"]]
            for t, action in enumerate(columns["action"]):
                if t and rocksample.actions[action] == "sample()":
                    rock = rocks[tuple(columns["visible"][t])]
                    assert columns["reward"][t] == (10 if good[rock] else -10)
                    paid.add(columns["reward"][t])
                    good[rock] = False
            assert columns["hidden"]["end"] == ["good" if each else "bad" for each in good]
        assert paid == {10, -10}

    def test_where_the_hidden_robot_was(self, hidden):
        """Its moves from where it began lead to where it met the other one."""
        by = {"up": (-1, 0), "down": (1, 0), "left": (0, -1), "right": (0, 1)}
        ends = set()
        for k in range(5):
            columns = episode(hidden, policy.make("sarsop", hidden)[1], 0, k, 50)
            row, column = eval(columns["hidden"]["start"][0])
            for action in columns["action"][1:]:
                name, _, number = hidden.actions[action].rstrip(")").partition("(")
                if number == "2":
                    row = min(max(row + by[name][0], 1), 7)
                    column = min(max(column + by[name][1], 1), 6)
            assert columns["terminated"]
            assert columns["hidden"]["end"] == [f"({row}, {column})"]
            assert columns["visible"][-2] == [row, column]  # robot 1
            ends.add((row, column))
        assert {column for _, column in ends} == {6}
        assert episode(harness.load("bordercross-7x8"), RandomPolicy(), 0, 0, 5)["hidden"] == {"start": [], "end": []}

    def test_an_endless_episode_is_not_written_out(self, report_inputs, tmp_path):
        table = pd.read_csv(report_inputs["rocks.csv"]).assign(horizon=10**9)
        table.to_csv(tmp_path / "t.csv", index=False)
        found = write(tmp_path, tmp_path / "t.csv")
        assert "No replay of sarsop: a page shows episodes of 10,000 steps at most" in found.text

    def test_no_episodes_no_player(self, report_inputs, tmp_path):
        found = write(tmp_path, *report_inputs.values(), episodes=0)
        assert found.count("div", **{"class": "player"}) == 0
        assert "No replay" not in found.text

    def test_what_cannot_be_played_is_said(self, report_inputs, tmp_path):
        table = pd.read_csv(report_inputs["rocks.csv"])
        table.loc[0, "policy"] = "my own object"
        table.loc[2, "domain_version"] = 2
        table.to_csv(tmp_path / "t.csv", index=False)
        found = write(tmp_path, tmp_path / "t.csv")
        assert "No replay of my own object: no policy 'my own object'" in found.text
        assert "No replay of exit: the results are of another version of rocksample-7x8" in found.text
        assert [each["name"] for each in found.data[-1]["policies"]] == ["sarsop"]

    def test_a_domain_of_ones_own(self, rocksample, tmp_path, capsys):
        """Without a layout: no map, but everything else."""
        own = dataclasses.replace(rocksample, name="lion", layout={"kind": "none"})
        domain.save(own, tmp_path / "lion.npz")
        table = harness.compare(own, ["random"], episodes=5, engine="tables")
        (tmp_path / "t.json").write_text(harness.render(table, "json"))
        found = write(tmp_path, tmp_path / "t.json")
        assert "No replay of random: no domain 'lion'" in found.text
        arguments = ["--out", str(tmp_path / "out"), "--domain", str(tmp_path / "lion.npz")]
        assert main(["report", str(tmp_path / "t.json"), *arguments]) == 0
        assert f"{tmp_path / 'out' / 'index.html'}: " in capsys.readouterr().out
        record = Reader((tmp_path / "out" / "index.html").read_text(encoding="utf-8")).data[-1]
        assert record["domain"]["layout"] == {"kind": "none"}
        assert record["domain"]["features"] == [f"belief({i})" for i in range(1, 9)]
        assert write(tmp_path, tmp_path / "t.json", domains=[own]).data[-1] == record

    def test_a_policy_that_stops_is_said_to(self, rocksample, tmp_path):
        (tmp_path / "p.txt").write_text("check(3)\ncheck(3)\n")
        made = policy.make(f"program:{tmp_path / 'p.txt'}", rocksample)[1]
        columns = episode(rocksample, made, 0, 0, 50)
        assert columns["ending"] == "was left by its policy"
        assert len(columns["action"]) == 3
        last = list(replay(rocksample, f"program:{tmp_path / 'p.txt'}", engine="tables"))[-1]
        assert last.startswith("The episode was left by its policy after 2 steps")


def spoil_json(content):
    record = json.loads(content)
    where = [record]
    for place in where:
        where += [
            each for each in (place.values() if isinstance(place, dict) else place) if isinstance(each, dict | list)
        ]
    for place in where:
        for key in list(place) if isinstance(place, dict) else range(min(2, len(place))):
            kept = place[key]
            for wrong in (None, "word", {}):
                place[key] = wrong
                yield json.dumps(record)
            place[key] = kept
            if isinstance(place, dict):
                yield json.dumps(record).replace(json.dumps(key), '"other"', 1)


def spoil_csv(content):
    table = pd.read_csv(io.StringIO(content), dtype=str, keep_default_na=False)
    for column in table:
        yield table.drop(columns=column).to_csv(index=False)
        for wrong in ("", "word", "-1", "1e400"):
            spoilt = table.copy()
            spoilt.loc[0, column] = wrong
            yield spoilt.to_csv(index=False)


def unpacked(columns):
    """With ``beliefs``: all features at every step."""
    n = 1 + max(index for changes in columns["belief"] for index in changes[::2])
    beliefs = np.zeros((len(columns["belief"]), n))
    for t, changes in enumerate(columns["belief"]):
        beliefs[t] = beliefs[t - 1] if t else 0
        beliefs[t, changes[::2]] = np.array(changes[1::2]) / 1000
    return {**columns, "beliefs": beliefs}


class TestDifferences:
    LONG = "".join(f"check({i})\n" for i in range(1, 9))

    def test_lines_that_stay_the_same_are_left_out(self):
        text = Reader(programs.difference(self.LONG + self.LONG, "up()\n" + self.LONG + self.LONG + "up()\n")).text
        assert text == "+ up()\n  check(1)\n  check(2)\n  ⋯\n  check(7)\n  check(8)\n+ up()\n"
        assert "No line" in programs.difference(self.LONG, self.LONG)

    def test_words_are_marked_where_lines_were_altered_only(self):
        one = programs.difference("if(belief(3) > 0.74) up()\n", "if(belief(3) > 0.8) up()\n")
        assert re.findall("<mark>(.*?)</mark>", one) == ["0.74", "0.8"]
        assert "<mark>" not in programs.difference("up()\n", "down()\nup(1)\n")

    def test_adding_up_the_lines_gives_either_program(self):
        old, new = (
            stored_program(registry.program_path("rocksample-7x8", word), harness.load("rocksample-7x8")).text
            for word in ("ge", "ge-feedback")
        )
        said = Reader(programs.difference(old, new)).text.splitlines()
        for text, sign in ((old, "-"), (new, "+")):
            shown = [line[2:] for line in said if line[0] in (" ", sign) and line != "  ⋯"]
            kept = iter(text.splitlines())
            assert all(line in kept for line in shown)  # in this order
        gone, come = (sum(line[0] == sign for line in said) for sign in "-+")
        assert programs.changes(old, new) == f"{gone} lines gone, {come} new"

    def test_what_is_too_long_is_not_compared(self):
        assert "are not compared" in programs.difference("up()\n", "up()\n" * 1001)
        assert programs.changes("up()\n", "up()\n" * 1001) == "1 lines before, 1,001 now"
        wide = "up() " * 60
        assert "<mark>" not in programs.difference(wide, wide + "down()")


class TestAxes:
    def test_near_the_top(self):
        assert charts.near_the_top(pd.Series([0.0, 40.0, 50.0])) == 42.5
        assert charts.near_the_top(pd.Series([45.0, 50.0])) is None
        assert charts.near_the_top(pd.Series([-20.0, -10.0])) == -11.5

    def test_outliers(self):
        learning = pd.Series([-900.0, *np.linspace(0, 40, 41)])
        bottom = charts.without_outliers(learning)
        assert bottom is not None
        assert (learning < bottom).sum() == 1
        assert charts.without_outliers(learning[1:]) is None
        assert charts.without_outliers(pd.Series([5.0, 5.0])) is None
        assert charts.without_outliers(pd.Series([np.nan, -np.inf])) is None
