"""Forest plot: the standardized difference of each metric with its interval."""

from collections.abc import Sequence
from io import BytesIO
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import imsave

from app.cohort import METRICS, Comparison
from app.report.colors import EFFECT, INK

_DPI = 120


def forest_png(comparisons: Sequence[Comparison]) -> bytes | None:
    """Draw the plot as PNG; None if no metric has a spread."""
    shown = [(c, c.standardized) for c in comparisons if c.standardized is not None]
    if not shown:
        return None
    figure = Figure(figsize=(13.0, 1.4 + 0.42 * len(shown)), dpi=_DPI, layout="constrained")
    canvas: Any = FigureCanvasAgg(figure)
    plot = figure.subplots()
    for place, (comparison, (centre, low, high)) in enumerate(shown):
        plot.plot([low, high], [place, place], color=EFFECT, linewidth=2.0)
        plot.plot([centre], [place], marker="s", markersize=7, color=EFFECT)
        plot.annotate(
            f"{comparison.difference:+.3g} [{comparison.low:.3g}, {comparison.high:.3g}]",
            (1.01, place),
            xycoords=("axes fraction", "data"),
            va="center",
            color=INK,
        )
    plot.axvline(0.0, color=INK, linewidth=0.8)
    plot.set_yticks(range(len(shown)), [METRICS[c.metric] for c, _ in shown], color=INK)
    plot.set_ylim(len(shown) - 0.5, -0.5)
    first, second = shown[0][0].groups
    plot.set_xlabel(
        f"{second} minus {first}, in pooled standard deviations (Hedges' g), 95 % interval; "
        "right: in the metric's unit",
        color=INK,
        parse_math=False,
    )
    for side in ("top", "right", "left"):
        plot.spines[side].set_visible(False)
    plot.tick_params(axis="y", length=0)
    canvas.draw()
    picture = BytesIO()
    metadata: Any = {"Software": None}
    imsave(picture, canvas.buffer_rgba(), format="png", dpi=_DPI, metadata=metadata)
    return picture.getvalue()
