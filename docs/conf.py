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

from app import __version__  # noqa: E402

_PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]

project = "MarginGuard"
author = "The MarginGuard developers"
copyright = "MarginGuard developers, Apache-2.0. A research tool, not a medical device"
version = release = __version__

extensions = [
    "myst_nb",  # Markdown pages, and notebooks with their figures
    "sphinx.ext.autodoc",
    "sphinx.ext.viewcode",
    "sphinxcontrib.mermaid",
    "repository_links",
]
root_doc = "docs/index"
include_patterns = ["docs/**", "examples/*", "data/*/README.md", "*.md"]
exclude_patterns = [".*", "out", "build", "dist", "app", "tests", "**/__pycache__"]
nitpicky = True

# Markdown: what the web view of a Git host shows, with the same anchors.
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4
myst_fence_as_directive = ["mermaid"]

# Notebooks are executed at every build; an error of a cell fails the build.
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 120

# Diagrams are drawn at build time by mermaidx: pages load nothing from other hosts.
mermaid_output_format = "svg"
mermaid_cmd = shlex.join([sys.executable, "-m", "mermaidx", "--quiet", "-b", "white"])

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_class_signature = "mixed"

html_theme = "furo"
html_title = "MarginGuard"
html_static_path = ["site/static"]
html_css_files = ["site.css"]
html_extra_path = ["site/root"]
html_copy_source = False
repository_url = _PROJECT["urls"]["Repository"]
