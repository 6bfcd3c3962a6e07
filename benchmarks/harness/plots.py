"""Plots of figures as PNG files in one style."""

from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

INK = "#1c2733"


def new_figure(width: float, height: float) -> Figure:
    return Figure(figsize=(width, height), dpi=100, layout="constrained")


def open_axes(axes: Axes, sides: Sequence[str] = ("top", "right")) -> None:
    for side in sides:
        axes.spines[side].set_visible(False)


def write_png(figure: Figure, path: Path) -> None:
    FigureCanvasAgg(figure).print_png(path)
