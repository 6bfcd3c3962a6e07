"""Reliability diagram of `marginguard bench probability`."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

if TYPE_CHECKING:
    from benchmarks.probability import Bin

_INK, _MARK = "#1c2733", "#0b5ea8"


def write_plot(path: Path, bins: "Sequence[Bin]", values: Mapping[str, float]) -> None:
    """Draw the share of breaches over the predicted probability, with the spread of chance."""
    figure = Figure(figsize=(6.0, 7.4), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(4, 1))
    predicted = [each.predicted for each in bins]
    upper.plot([0.0, 1.0], [0.0, 1.0], color=_INK, lw=0.8, label="calibrated")
    upper.errorbar(
        predicted,
        [each.observed for each in bins],
        yerr=[2.0 * each.spread for each in bins],
        fmt="o",
        color=_MARK,
        capsize=3.0,
        label="cases by tenths of probability; 2 standard deviations by chance",
    )
    upper.set_title(
        f"{values['cases']:.0f} simulated cases: Brier score {values['Brier score']:.3f} "
        f"({values['Brier score if calibrated']:.3f} if calibrated)",
        loc="left",
        color=_INK,
        fontsize=10,
    )
    upper.set_ylabel("share of cases with a true breach", color=_INK)
    upper.set_ylim(-0.02, 1.02)
    upper.legend(loc="upper left", frameon=False, labelcolor=_INK)
    lower.bar(predicted, [each.cases for each in bins], width=0.06, color=_MARK)
    lower.set_ylabel("cases", color=_INK)
    lower.set_xlabel("predicted probability of a breach", color=_INK)
    lower.set_xlim(-0.02, 1.02)
    for plot in (upper, lower):
        for side in ("top", "right"):
            plot.spines[side].set_visible(False)
    metadata: Any = {"Date": None} if path.suffix == ".svg" else {"Software": None}
    with mpl.rc_context({"svg.hashsalt": "marginguard"}):
        figure.savefig(path, metadata=metadata)
