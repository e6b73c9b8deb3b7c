"""Sphinx: the pages in Markdown, the reference from the docstrings. Builds without a network."""

import os
import sys
from importlib.metadata import version as version_of
from pathlib import Path

import nbformat
from sphinx.ext.napoleon import GoogleDocstring

import harness

DOCS = Path(__file__).parent
sys.path.insert(0, str(DOCS))

import generated  # noqa: E402
import stories  # noqa: E402

project = "POMDP benchmark harness"
author = "The POMDP benchmark harness developers"
copyright = f"2026, {author}"
version = release = version_of("pomdp-harness")

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "myst_nb",
]
SIZE = os.environ.get("HARNESS_NOTEBOOK_SIZE", "full")
if SIZE == "full":  # the sources as pages take half of the time, and a check in CI learns nothing by them
    extensions.append("sphinx.ext.viewcode")
myst_enable_extensions = ["colon_fence", "substitution"]
myst_substitutions = generated.figures() | generated.limits()
myst_heading_anchors = 3
default_role = "code"  # what stands between single backquotes is code, as in Markdown

html_theme = "furo"
html_title = f"{project} {version}"

autodoc_default_options = {"members": True, "member-order": "bysource", "show-inheritance": True}
napoleon_numpy_docstring = False
# Napoleon takes what stands before a colon in an attribute's docstring for its type; ours are annotated.
GoogleDocstring._parse_attribute_docstring = GoogleDocstring._consume_to_end

# Types of other packages would need their inventories, and so a network; a type of ours must be found.
# Where autodoc cannot resolve an annotation (behind functools.lru_cache, in a dataclass of another module's class) it
# links the bare name, which several classes may have.
suppress_warnings = ["ref.python"]
nitpick_ignore_regex = [("py:class", r"(?!harness\.).*"), ("py:class", r"harness\..*\._\w+")]

nb_execution_mode = "off"  # they come with their outputs
nb_output_stderr = "warn"
for path in stories.SOURCES:
    book = stories.page(path, SIZE)
    (DOCS / "notebooks").mkdir(exist_ok=True)
    nbformat.write(book, DOCS / "notebooks" / path.name)
os.environ["COLUMNS"] = "100"  # of the help texts of the commands


def _public_name(app, env, node, contnode):
    """``harness.compare`` leads to where it is defined, ``harness.score.comparison.compare``."""
    package, _, name = node.get("reftarget", "").rpartition(".")
    if package != "harness" or name not in harness.__all__:
        return None
    target = f"{getattr(harness, name).__module__}.{name}"
    return env.get_domain("py").resolve_xref(env, node["refdoc"], app.builder, "obj", target, node, contnode)


def _add_generated(app, docname, source):
    made = {
        "command-line": generated.commands, "literature": generated.literature, "baselines": generated.baselines
    }.get(docname)  # fmt: skip
    source[0] += made() if made else ""


def setup(app):
    """Called by Sphinx."""
    app.connect("missing-reference", _public_name)
    app.connect("source-read", _add_generated)
