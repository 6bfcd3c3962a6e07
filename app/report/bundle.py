"""Style sheets of the pages and scripts of their figures, which a page holds itself."""

from base64 import b64encode
from functools import cache
from hashlib import sha256
from importlib.resources import files


@cache
def page_style() -> str:
    """The style sheet of every page."""
    return _text("page.css")


@cache
def figure_style() -> str:
    """The style sheets of the figures."""
    return "".join(map(_text, ("uplot.min.css", "plots.css", "coverage.css")))


@cache
def figure_scripts() -> tuple[str, ...]:
    """uPlot, the script that draws the plots with it, and that of the coverage.

    They are put after the figures.
    """
    return tuple(map(_text, ("uplot.min.js", "plots.js", "coverage.js")))


def csp_source(text: str) -> str:
    """Source of a Content-Security-Policy that allows an element with the content ``text``."""
    return f"'sha256-{b64encode(sha256(text.encode()).digest()).decode()}'"


def _text(name: str) -> str:
    return (files("app.report") / "web" / name).read_text(encoding="utf-8")
