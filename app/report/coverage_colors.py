"""Colours of the tumour's coverage: classes of the least distance, their light, marks of breaches.

The lighter, the farther. In each light the classes keep their order of luminance, also for
colour-blind readers.
"""

from app.analysis.coverage import WITHIN_MM

COLORS = ("#3a0a20", "#931d22", "#d0551d", "#efa23a", "#f6f8fa")
"""Least distance up to each of `WITHIN_MM`, and beyond the last."""
CLASS_NAMES = (*(f"within {within:g} mm" for within in WITHIN_MM), "farther")
AMBIENT, DIRECT = 0.85, 0.15
"""Light of a face at the edge of the picture, and what it has more where it faces the reader."""
INK, PAPER = "#1c2733", "#ffffff"
"""Line and ground of the labels and of the marks of breaches."""


def shaded(number: int, light: float) -> str:
    """The colour of class ``number`` in ``light``, 0 to 1, as ``#rrggbb``."""
    base = COLORS[number]
    level = round(light * 20.0) / 20.0  # few colours: a smaller file
    return "#" + "".join(f"{round(int(base[k : k + 2], 16) * level):02x}" for k in (1, 3, 5))
