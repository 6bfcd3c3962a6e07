"""Configuration of the documentation site (`make docs`).

The source folder of Sphinx is the root of the project: links between README.md, docs/ and examples/
are the same here and on the web view of a Git host.
"""

import shlex
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "docs" / "site")]

import numpy as np  # noqa: E402
from numpy.typing import ArrayLike, NDArray  # noqa: E402
from sphinx.application import Sphinx  # noqa: E402
from sphinx.util.typing import stringify_annotation  # noqa: E402

import marginguard  # noqa: E402
from app import __version__  # noqa: E402

_PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]

project = "MarginGuard"
author = "The MarginGuard developers"
copyright = "MarginGuard developers, Apache-2.0. A research tool, not a medical device"
version = release = __version__

extensions = [
    "myst_nb",  # Markdown pages, and notebooks with their figures
    "sphinx.ext.autodoc",
    "sphinxcontrib.mermaid",
    "repository_links",
]
root_doc = "docs/index"
include_patterns = ["docs/**", "examples/*", "examples/*/README.md", "data/*/README.md", "*.md"]
exclude_patterns = [".*", "out", "build", "dist", "app", "tests", "**/__pycache__"]
nitpicky = True

# Markdown: what the web view of a Git host shows, with the same anchors.
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4
myst_fence_as_directive = ["mermaid"]

# Notebooks are executed at every build; an error of a cell fails the build.
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 600  # a first run compiles the kernels

# Diagrams are drawn at build time by mermaidx: pages load nothing from other hosts.
mermaid_output_format = "svg"
mermaid_cmd = shlex.join([sys.executable, "-m", "mermaidx", "--quiet", "-b", "white"])

default_role = "code"  # single backquotes in docstrings
autodoc_member_order = "bysource"
python_use_unqualified_type_names = True
# Inventories of other projects are on other hosts, so their types have no links. Types of `app`
# that the API does not export are values to be read: their fields may change.
nitpick_ignore_regex = [
    (r"py:.*", r"(numpy|pandas|matplotlib|os|pathlib|collections|typing|app)\..*"),
    (
        r"py:.*",
        r"NDArray|ArrayLike|float64|int32|int64|DataFrame|Figure|ConstraintReader|FixtureConstraint|TimeOffset",
    ),
]

html_theme = "furo"
pygments_dark_style = "monokai"
html_title = "MarginGuard"
html_static_path = ["site/static"]
html_css_files = ["site.css"]
html_extra_path = ["site/root"]
html_copy_source = False
repository_url = _PROJECT["urls"]["Repository"]

_TYPES = {
    "NDArray[float64]": NDArray[np.float64],
    "NDArray[int32]": NDArray[np.int32],
    "NDArray[int64]": NDArray[np.int64],
    "ArrayLike": ArrayLike,
}
_WRITTEN = {stringify_annotation(type_, "smart"): name for name, type_ in _TYPES.items()}
"""Names of numpy's types, by the text that each stands for."""


def _export(name: str) -> None:
    """Let a class of the API be named, and linked, as what it is imported from."""
    exported = getattr(marginguard, name)
    if isinstance(exported, type):
        exported.__module__ = "marginguard"


def _name_types(
    app: Sphinx, what: str, name: str, value: object, options: object, *texts: str | None
) -> tuple[str | None, ...]:
    """Name the types of numpy in a signature and in the type of its result."""
    named = []
    for text in texts:
        for type_, written in _WRITTEN.items():
            text = text and text.replace(type_, written)
        named.append(text)
    return tuple(named)


def setup(app: Sphinx) -> None:
    """Called by Sphinx."""
    for name in marginguard.__all__:
        _export(name)
    app.connect("autodoc-process-signature", _name_types)
