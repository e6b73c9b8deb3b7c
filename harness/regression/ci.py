"""A check told to machines: JUnit's XML, and GitHub's annotations and step summary."""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree

from harness.errors import HarnessError
from harness.regression import reports
from harness.regression.judging import Outcome, ScoreCheck


def junit(check: ScoreCheck) -> str:
    """A JUnit test suite as XML: one test case a row.

    A row that did not hold its score is a failure, one that has no comparable score is an error.
    """
    failures = [o for o in check.outcomes if o.verdict in ("worse", "differs")]
    errors = [o for o in check.outcomes if not o.passed and o not in failures]
    counts = {"tests": len(check.outcomes), "failures": len(failures), "errors": len(errors), "skipped": 0}
    attributes = {name: str(count) for name, count in counts.items()}
    attributes["time"] = f"{sum(o.seconds for o in check.outcomes):.3f}"
    root = ElementTree.Element("testsuites", attributes)
    suite = ElementTree.SubElement(root, "testsuite", {"name": "harness check", **attributes})
    for outcome in check.outcomes:
        case = ElementTree.SubElement(
            suite,
            "testcase",
            {
                "classname": _xml(outcome.row.domain),
                "name": _xml(outcome.row.policy),
                "file": _xml(check.path.as_posix()),
                "line": str(outcome.line),
                "time": f"{outcome.seconds:.3f}",
            },
        )
        said = _xml(reports.sentence(outcome))
        if outcome.passed:
            ElementTree.SubElement(case, "system-out").text = f"{outcome.verdict}: {said}"
        else:
            tag = "failure" if outcome in failures else "error"
            ElementTree.SubElement(case, tag, {"type": outcome.verdict, "message": said}).text = said
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _xml(text: str) -> str:
    """Without the control characters that XML 1.0 cannot hold."""
    return re.sub(r"[\x00-\x08\x0b\x0c\x0e-\x1f\ufffe\uffff]", "?", text)


def github_annotations(check: ScoreCheck) -> str:
    """GitHub's workflow commands: an error for every row that failed, a notice for every one that changed."""
    noted = [o for o in check.outcomes if not o.passed or o.verdict in ("changed", "better")]
    return "".join(f"{_annotation(check, outcome)}\n" for outcome in noted)


def _annotation(check: ScoreCheck, outcome: Outcome) -> str:
    level = "notice" if outcome.passed else "error"
    title = f"{outcome.row.policy} on {outcome.row.domain}: {outcome.verdict}"
    file = _property(check.path.as_posix())
    message = _data(reports.sentence(outcome))
    return f"::{level} file={file},line={outcome.line},title={_property(title)}::{message}"


def _data(text: str) -> str:
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _property(text: str) -> str:
    return _data(text).replace(":", "%3A").replace(",", "%2C")


def append_summary(check: ScoreCheck, path: Path) -> None:
    """Append the table as Markdown to a file: the one that GitHub names in ``GITHUB_STEP_SUMMARY``.

    Raises:
        HarnessError: the file cannot be written.
    """
    heading = "Scores: " + ("none got worse" if check.passed else "some rows failed")
    body = f"### {heading}\n\n{reports.table(check.outcomes, 'github')}\n\n{reports.footnote(check)}\n"
    try:
        with path.open("a", encoding="utf-8") as file:
            file.write(body)
    except OSError as error:
        raise HarnessError(f"cannot write {path}: {error.strerror}") from None
