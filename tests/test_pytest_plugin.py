"""The fixture ``score_regression``, in pytest runs inside pytest."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from harness.play.conformance import check_policy
from harness.regression import single

pytest_plugins = ["pytester"]

ROOT = Path(__file__).parent.parent
# What would take most of the time: a collection of all garbage, and the import of Hypothesis, in every run.
QUICK = ("-p", "no:cacheprovider", "-p", "no:unraisableexception", "-p", "no:hypothesispytest")
PLUGIN = ("-p", "harness.pytest_plugin", *QUICK)

CHECK = """
def test_exit(score_regression):
    score_regression.check("{policy}", "rocksample-7x8", episodes={episodes}, engine="tables")
"""
OWN = """
import numpy as np

class Mine:
    name = "mine"
    def reset(self, batch):
        pass
    def act(self, batch):
        return np.full(batch.size, batch.domain.action("{action}"))

def test_mine(score_regression):
    score_regression.check(Mine(), "rocksample-7x8", episodes=200, engine="tables")
"""


@pytest.fixture(autouse=True, scope="module")
def everything_loaded(tmp_path_factory, rocksample):
    """pytester forgets the modules that a run inside this process was the first to import; Numba cannot bear that."""
    path = tmp_path_factory.mktemp("warm") / "score.toml"
    how = {"seed": 0, "horizon": 50, "engine": "tables", "max_episodes": None}
    for episodes in (30, 40):
        single.check(path, single.task("random", rocksample, episodes=episodes, **how), {}, exact=True, renew=False)
    check_policy("random", rocksample, episodes=4)


@pytest.fixture
def project(pytester):
    """A folder with a test module, as a researcher has it."""

    def write(text, **values):
        return pytester.makepyfile(test_policies=text.format(**values) if values else text)

    return write


def run(pytester, *arguments, **expected):
    result = pytester.runpytest_inprocess(*PLUGIN, *arguments)
    result.assert_outcomes(**expected)
    return result.stdout.str()


def test_the_first_run_writes_and_fails_the_second_passes(pytester, project):
    project(CHECK, policy="belief:0.84", episodes=500)
    out = run(pytester, failed=1)
    path = pytester.path / "test_policies" / "test_exit.toml"
    assert "belief:0.84 on rocksample-7x8: no score was stored; now it is, in " in out
    assert "Traceback" not in out
    assert "pytest_plugin.py" not in out  # our frames are hidden
    before = path.read_text()
    assert before.count("[[stored]]") == 1
    run(pytester, passed=1)
    run(pytester, "--force-regen", passed=1)  # nothing has changed, so nothing is stored anew
    assert path.read_text() == before


def test_ones_own_policy_that_got_worse_fails_with_a_table(pytester, project):
    project(OWN, action="right()")
    run(pytester, failed=1)
    run(pytester, passed=1)
    project(OWN, action="up()")
    out = run(pytester, failed=1)
    assert "mine on rocksample-7x8 got worse by " in out
    assert re.search(r"obtained +expected +difference", out)
    assert re.search(r"mean +-47\d\d +10 +-4", out)  # three free moves, then 47 at −100
    assert "if the change is meant: pytest --force-regen" in out
    assert "pytest_plugin.py" not in out


def test_an_object_that_acts_otherwise_in_other_batches_has_no_score(pytester, project):
    drawing = "self.rng.integers(0, 4, batch.size)"
    text = OWN.replace("        pass\n", "        self.rng = np.random.default_rng(0)\n")
    project(text.replace('np.full(batch.size, batch.domain.action("{action}"))', drawing))
    out = run(pytester, failed=1)
    assert "mine acts otherwise in batches of 7 (" in out
    assert "pytest_plugin.py" not in out
    assert not (pytester.path / "test_policies").exists()


def test_force_regen_stores_anew_and_fails(pytester, project):
    project(OWN, action="right()")
    run(pytester, failed=1)
    project(OWN, action="up()")
    out = run(pytester, "--force-regen", failed=1)
    assert "mine on rocksample-7x8: stored anew" in out
    run(pytester, passed=1)


def test_a_change_that_is_no_loss_passes_unless_exact(pytester, project):
    text = CHECK.format(policy="exit", episodes=100)
    project(text)
    run(pytester, failed=1)
    path = pytester.path / "test_policies" / "test_exit.toml"
    path.write_text(path.read_text().replace('digest = "', 'digest = "0'))
    run(pytester, passed=1)
    project(text.replace("episodes=100", "episodes=100, exact=True"))
    assert "the same episodes came out differently" in run(pytester, failed=1)


def test_damaged_and_foreign_files_fail(pytester, project):
    project(CHECK, policy="exit", episodes=100)
    run(pytester, failed=1)
    path = pytester.path / "test_policies" / "test_exit.toml"
    whole = path.read_text()
    path.write_text(re.sub("sem = .*\n", "", whole, count=1))
    assert "'sem' is missing; run pytest --force-regen" in run(pytester, failed=1)
    path.write_text("")
    assert "no score of it is stored, but nothing" in run(pytester, failed=1)
    path.write_text(whole.replace('"exit"', '"random"'))
    assert "but random on rocksample-7x8, horizon 50" in run(pytester, failed=1)
    run(pytester, "--force-regen", failed=1)
    assert path.read_text() == whole


def test_several_checks_need_names(pytester, project):
    body = CHECK.format(policy="exit", episodes=100)
    again = '    score_regression.check("random", "rocksample-7x8", episodes=100, engine="tables"{})\n'
    project(body + again.format(""))
    run(pytester, failed=1)
    assert "two checks of test_exit share the name 'test_exit': give them names (name=…)" in run(pytester, failed=1)
    project(body + again.format(", name='the random one'"))
    run(pytester, failed=1)
    run(pytester, passed=1)
    stems = sorted(path.stem for path in (pytester.path / "test_policies").iterdir())
    assert stems == ["test_exit", "the_random_one"]


def test_parameters_and_classes_get_files_of_their_own(pytester, project):
    project("""
import pytest

class TestA:
    @pytest.mark.parametrize("policy", ["exit", "belief:0.9"])
    def test_it(self, score_regression, policy):
        score_regression.check(policy, "rocksample-7x8", episodes=100, engine="tables")
""")
    run(pytester, failed=2)
    run(pytester, passed=2)
    stems = sorted(path.name for path in (pytester.path / "test_policies").iterdir())
    assert stems == ["TestA.test_it_belief_0.9_.toml", "TestA.test_it_exit_.toml"]


@pytest.mark.parametrize(
    ("argument", "words"),
    [
        ("episodes=3", "episodes must be 30 or more, not 3"),
        ("min_efect=0.1", "did you mean 'min_effect'"),
        ("false_alarm=2.0", "false_alarm must lie between 0 and 1"),
        ("engine='tabels'", "did you mean 'tables'"),
    ],
)
def test_wrong_arguments_are_told(pytester, project, argument, words):
    project(CHECK.replace('episodes={episodes}, engine="tables"', argument).replace("{policy}", "exit"))
    assert words in run(pytester, failed=1)
    assert not (pytester.path / "test_policies").exists()


OTHER = """
def pytest_addoption(parser):
    parser.getgroup("regressions").addoption("--force-regen", action="store_true", default=False)
"""


@pytest.mark.parametrize("order", [("other", "harness.pytest_plugin"), ("harness.pytest_plugin", "other")])
def test_beside_another_plugin_with_the_same_option(pytester, project, order):
    """pytest-regressions defines ``--force-regen`` in just this way; whichever is loaded first, both work."""
    pytester.makepyfile(other=OTHER)
    pytester.syspathinsert()
    project(OWN, action="right()")
    arguments = [word for name in order for word in ("-p", name)]
    pytester.runpytest_inprocess(*QUICK, *arguments).assert_outcomes(failed=1)
    project(OWN, action="up()")
    result = pytester.runpytest_inprocess(*QUICK, *arguments, "--force-regen")
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["*stored anew*"])


def test_the_option_is_in_the_help(pytester):
    result = pytester.runpytest_inprocess(*PLUGIN, "--help")
    assert result.stdout.str().count("--force-regen") == 1


def test_loading_the_plugin_loads_nothing_heavy():
    """Every pytest run of an environment loads it."""
    heavy = "{'numpy', 'numba', 'scipy', 'pandas', 'tqdm', 'tabulate', 'juliacall'}"
    script = f"import pytest, sys; import harness.pytest_plugin; print({heavy} & set(sys.modules))"
    command = [sys.executable, "-W", "error", "-c", script]
    result = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT)
    assert result.stdout.strip() == "set()"


def test_the_entry_point_is_named_like_its_module():
    """Under any other name, an installed plugin and ``-p harness.pytest_plugin`` would be registered twice."""
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    section = text[text.index("[project.entry-points.pytest11]") :].splitlines()[1]
    assert section == '"harness.pytest_plugin" = "harness.pytest_plugin"'
