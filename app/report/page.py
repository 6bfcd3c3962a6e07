"""Pages of reports, from the templates in ``templates``; every value of a page is escaped.

Also the colours of reports, but those of the margin's states: `app.fixture.control.states`.
"""

import json
from base64 import b64encode
from functools import cache
from hashlib import sha256
from importlib.resources import files
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from app.analysis.coverage import WITHIN_MM
from app.fixture import MarginState

INK, PAPER = "#1c2733", "#ffffff"
"""Text and lines on their ground."""
SOFT, LINE, HATCH = "#51606e", "#d5dce3", "#5a5a5a"
"""Notes, grids, hatches."""
STOP, WARN, LOWER_BOUND, BREACH = "#a32a14", "#8a6100", "#8b97a3", "#7d1d0d"
"""Lines of the margins and of the bound of the distance; text of a breach."""
INSIDE_BAR, STOP_BAR, WARN_BAR, CLEAR_BAR = STOP, "#d98a00", "#e9c46a", "#3d8fb5"
"""Bars of time at distances inside, below the stop margin, below the warning distance, beyond."""
USED, DROPPED, EFFECT = "#0072b2", "#c8381e", "#0b5ea8"
"""Bars of residuals; intervals of a comparison."""
PAGE_COLORS = {
    "ink": INK,
    "line": LINE,
    "note": SOFT,
    "focus": CLEAR_BAR,
    "device": DROPPED,
    "fail": STOP,
    "inside": MarginState.POSITIVE.display.color_hex,
    "unknown": MarginState.UNKNOWN.display.color_hex,
    "clear": MarginState.NEGATIVE.display.color_hex,
}
"""Colours of a page, by the names of their variables in its style sheet."""

COLORS = ("#3a0a20", "#931d22", "#d0551d", "#efa23a", "#f6f8fa")
"""Coverage: least distance up to each of `WITHIN_MM`, and beyond the last.

The lighter, the farther: in each light the classes keep their order of luminance, also for
colour-blind readers.
"""
CLASS_NAMES = (*(f"within {within:g} mm" for within in WITHIN_MM), "farther")
AMBIENT, DIRECT = 0.85, 0.15
"""Light of a face at the edge of the picture, and what it has more where it faces the reader."""


def shaded(number: int, light: float) -> str:
    """The colour of class ``number`` in ``light``, 0 to 1, as ``#rrggbb``."""
    base = COLORS[number]
    level = round(light * 20.0) / 20.0  # few colours: a smaller file
    return "#" + "".join(f"{round(int(base[k : k + 2], 16) * level):02x}" for k in (1, 3, 5))


NOT_A_DEVICE = (
    "MarginGuard is research software. It is not a medical device and must not be used to treat "
    "or diagnose a patient."
)
Cell = str | int | float | None


@cache
def page_style() -> str:
    """The style sheet of every page."""
    colors = " ".join(f"--{name}: {color};" for name, color in PAGE_COLORS.items())
    return f":root {{ {colors} }}\n{_text('page.css')}"


@cache
def figure_style() -> str:
    """The style sheets of the figures."""
    return "".join(map(_text, ("uplot.min.css", "plots.css", "turn.css")))


@cache
def figure_scripts() -> tuple[str, ...]:
    """uPlot, the script that draws the plots with it, and those of the figures that turn.

    They are put after the figures.
    """
    names = ("uplot.min.js", "plots.js", "turn.js", "coverage.js", "motion.js")
    return tuple(map(_text, names))


def csp_source(text: str) -> str:
    """Source of a Content-Security-Policy that allows an element with the content ``text``."""
    return f"'sha256-{b64encode(sha256(text.encode()).digest()).decode()}'"


def _text(name: str) -> str:
    return (files("app.report") / "web" / name).read_text(encoding="utf-8")


def document(template: str, title: str, *, figures: bool = False, **values: object) -> str:
    """The page of ``template``, which extends ``page.html``, with ``values``.

    With ``figures`` it has figures of `TimePlot.html` or `coverage_figure`, and the scripts that
    draw them. Its policy allows these scripts alone, by their hashes, and no other resources.
    """
    style = page_style() + (figure_style() if figures else "")
    scripts = figure_scripts() if figures else ()
    allowed = {
        "style_source": Markup(csp_source(style)),
        "script_sources": Markup(" ".join(map(csp_source, scripts)) or "'none'"),
    }
    parts = {"style": Markup(style), "scripts": [Markup(script) for script in scripts]}
    return str(part(template, title=title, **allowed, **parts, **values))


def part(template: str, **values: object) -> Markup:
    """The HTML of ``template`` with ``values``, of which a `Markup` is HTML already."""
    return Markup(_environment().get_template(template).render(**values))


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).with_name("templates")),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals["not_a_device"] = NOT_A_DEVICE
    environment.filters |= {
        "cell": text_of,
        "length": length,
        "time": time_text,
    }
    environment.filters["base64"] = lambda content: b64encode(content).decode("ascii")
    return environment


def json_of(value: object) -> Markup:
    """``value`` for a script element; a "<" of a text would end it."""
    text = json.dumps(value, allow_nan=False, separators=(",", ":"))
    return Markup(text.replace("<", "\\u003c"))


def length(value_mm: float | None) -> str:
    """A length with two decimals; a dash if it is not known."""
    return "-" if value_mm is None else f"{value_mm:.2f} mm"


def time_text(value_s: float) -> str:
    """A time in seconds with three decimals."""
    return f"{value_s:.3f} s"


def text_of(value: Cell | bool) -> str:
    """A value of a table; a dash if it is not known."""
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
