"""Bar plot of the residuals of a registration or calibration, with their RMS."""

from collections.abc import Sequence
from io import BytesIO

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from app.geometry import FloatArray
from app.report.colors import DROPPED, INK, USED
from app.report.rows import ReportError

_SIZE_INCHES = (10.0, 4.5)
_DPI = 120


def residual_png(
    values: FloatArray,
    *,
    title: str,
    what: str,
    unit: str,
    across: str,
    labels: Sequence[str] = (),
    outliers: Sequence[int] = (),
) -> bytes:
    """Draw a bar for each of ``values`` (n,) in ``unit``; return a PNG of 1200 x 540 pixels.

    ``across`` is the label of the x axis. ``labels`` names the bars; without it they are numbered
    from 1. ``outliers`` are the indices of dropped values: hatched, and not in the RMS. Raises
    `ReportError` without values.
    """
    if not len(values):
        raise ReportError("residuals: 0 values; expected at least 1")
    dropped = np.isin(np.arange(len(values)), np.asarray(outliers, dtype=int))
    figure = Figure(figsize=_SIZE_INCHES, dpi=_DPI, layout="constrained")
    plot = figure.subplots()
    plot.set_title(title, loc="left", color=INK, fontsize=13, fontweight="bold", parse_math=False)
    places = np.arange(1, len(values) + 1)
    plot.bar(places[~dropped], values[~dropped], color=USED, label="used")
    if dropped.any():
        plot.bar(
            places[dropped], values[dropped], color="white", edgecolor=DROPPED, hatch="////",
            label=f"dropped: {int(dropped.sum())}",
        )  # fmt: skip
    if not dropped.all():
        rms = float(np.sqrt(np.mean(values[~dropped] ** 2)))
        plot.axhline(rms, color=INK, ls=(0, (6, 4)), lw=1.2, label=f"RMS {rms:.3g} {unit}")
    if labels:
        plot.set_xticks(places, labels, parse_math=False)
    else:
        plot.xaxis.set_major_locator(MaxNLocator(integer=True))
    plot.set_xlabel(across, color=INK, fontsize=9)
    plot.set_ylabel(f"{what} [{unit}]", color=INK, fontsize=9)
    plot.margins(y=0.16)  # space for the legend above the bars
    plot.set_ylim(bottom=0.0)
    plot.grid(axis="y", color=INK, alpha=0.10, lw=0.6)
    plot.set_axisbelow(True)
    for side in ("top", "right"):
        plot.spines[side].set_visible(False)
    plot.legend(frameon=False, fontsize=9, labelcolor=INK, loc="upper right", ncols=3)
    FigureCanvasAgg(figure)
    picture = BytesIO()
    figure.savefig(picture, format="png", metadata={"Software": None})
    return picture.getvalue()
