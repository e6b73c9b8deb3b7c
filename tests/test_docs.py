"""The documentation keeps up with the code: its Python runs, and its lists are complete."""

from __future__ import annotations

import pkgutil
import re
from pathlib import Path

import pandas as pd
import pytest

import harness
from harness import bridge
from harness.cli import main
from harness.ge import grammar as bnf
from harness.ge.fitness import check_language
from harness.program import parse, words_of
from harness.score import bounds

ROOT = Path(__file__).parent.parent
PAGES = sorted((ROOT / "docs").glob("*.md"))
VERSION = harness.__version__  # which pyproject.toml reads too


def blocks(path, language):
    return re.findall(rf"^```{language}\n(.*?)^```", path.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)


@pytest.mark.parametrize("path", [path for path in PAGES if blocks(path, "python")], ids=lambda path: path.stem)
def test_the_python_of_a_page_runs(path):
    scope: dict = {}
    for block in blocks(path, "python"):
        exec(block, scope)


def test_the_program_and_the_grammar_shown_are_ones(rocksample, tmp_path):
    program, grammar, *_ = blocks(ROOT / "docs" / "programs.md", "text")
    assert parse(program, words_of(rocksample)).length == 4
    file = tmp_path / "shown.bnf"
    file.write_text(grammar, encoding="utf-8")
    check_language(bnf.read(file), words_of(rocksample))


def test_all_public_names_are_listed():
    listed = re.findall(r"^   harness\.(\w+)$", (ROOT / "docs" / "api" / "public.md").read_text(), re.MULTILINE)
    assert sorted(listed) == sorted(harness.__all__)


def test_the_page_of_the_commands_is_what_they_print(capsys, monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    monkeypatch.setenv("COLUMNS", "100")
    import generated

    page = generated.commands()
    commands = re.findall(r"^    ([a-z-]+)", _printed(capsys), re.MULTILINE)
    assert len(commands) > 10
    for command in commands:
        assert f"## `harness {command}`\n\n```text\n{_printed(capsys, command)}```\n" in page
    assert "cmaes     sigma=0.3" in page  # the settings of the methods are put in when help is asked for


def test_the_baselines_are_of_the_domains_and_bounds_that_ship(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    import generated

    table = pd.read_csv(ROOT / "docs" / "baselines.csv")
    page, known = generated.baselines(), generated.bounds().set_index("domain")
    assert set(table["domain"]) == set(known.index) == set(harness.names())
    for name, part in table.groupby("domain"):
        domain = harness.load(name)
        assert set(part["model_hash"]) == {domain.model_hash}, f"{name} has changed: play harness suite again"
        assert set(part["optimum_high"].dropna()) == {bounds.optimum(domain).high}, f"{name} was solved anew"
        assert float(known["lower"][name]) <= bounds.optimum(domain).low
        assert f"### {name}\n" in page


def _printed(capsys, *command):
    with pytest.raises(SystemExit):
        main([*command, "--help"])
    return capsys.readouterr().out


def test_every_module_is_in_the_reference():
    """But the commands: their help is their documentation."""
    modules = {module.name for module in pkgutil.walk_packages(harness.__path__, "harness.")}
    pages = (ROOT / "docs" / "api").glob("*.md")
    shown = {
        name for page in pages for name in re.findall(r"^\.\. automodule:: (\S+)$", page.read_text(), re.MULTILINE)
    }
    assert shown == {name for name in modules if not re.match(r"harness\.(cli|__main__)", name)}


def test_every_verb_of_the_interface_is_explained():
    source = (bridge.package_folder() / "src" / "interface.jl").read_text(encoding="utf-8")
    verbs = set(re.findall(r'^"""\n    (\w+)\(', source, re.MULTILINE))
    assert len(verbs) > 10
    page = (ROOT / "docs" / "new-domain.md").read_text(encoding="utf-8")
    assert verbs == set(re.findall(r"`(\w+)\(m[,)]", page))


def test_the_newest_version_of_the_changelog_is_the_package_s():
    versions = re.findall(r"^## \[(.*?)\]", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert versions[0] == VERSION


def test_the_citation_is_of_this_version():
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert re.search(r"^version: (.*)$", citation, re.MULTILINE)[1] == VERSION
