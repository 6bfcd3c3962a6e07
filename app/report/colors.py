"""Colours of reports, but those of the margin's states: `app.fixture.control.states`."""

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
