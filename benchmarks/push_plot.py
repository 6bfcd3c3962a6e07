"""Plot of `marginguard bench push`: true distance over time, with and without the fixture."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from app.fixture import MarginState
from app.geometry import FloatArray
from benchmarks.push_simulation import MARGINS

_INK, _STOP = "#1c2733", "#a32a14"
_OFF = "#7a8794"


def write_plot(
    path: Path, columns: Sequence[tuple[str, list[FloatArray], list[FloatArray]]]
) -> None:
    """Plot one column per title, with its pushes with the fixture and without.

    A push is (n, 3): time in s, true distance in mm, state.
    """
    figure = Figure(figsize=(13.0, 7.0), dpi=110, layout="constrained")
    plots = figure.subplots(2, len(columns), sharex="col", sharey="row", height_ratios=(3, 2))
    for (title, with_fixture, without), upper, lower in zip(
        columns, plots[0], plots[1], strict=True
    ):
        _draw(upper, with_fixture, without)
        upper.set_title(title, loc="left", color=_INK, fontsize=11, fontweight="bold")
        upper.set_ylim(-9.0, 16.0)
        _draw(lower, with_fixture, [])
        lower.set_ylim(0.0, 4.0)
        lower.set_xlabel("time [s]", color=_INK)
        end = max(float(push[-1, 0]) for push in with_fixture)
        lower.set_xlim(0.0, end)
    plots[0][0].set_ylabel("true signed distance [mm]", color=_INK)
    plots[1][0].set_ylabel("the same, near the stop [mm]", color=_INK)
    figure.legend(
        handles=[
            *(
                Line2D([], [], color=state.color, lw=2, label=f"fixture on, {name}")
                for state, name in (
                    (MarginState.NEGATIVE, "NEGATIVE"),
                    (MarginState.WARNING, "WARNING"),
                )
            ),
            Line2D([], [], color=_INK, lw=2, label="one of them"),
            Line2D([], [], color=_OFF, lw=1.2, ls="--", label="fixture off"),
            Line2D([], [], color=_STOP, lw=1.4, label=f"stop, {MARGINS.stop_mm:g} mm"),
        ],
        loc="outside lower center",
        ncols=6,
        frameon=False,
        labelcolor=_INK,
    )
    FigureCanvasAgg(figure)
    figure.savefig(path, metadata={"Software": None})


def _draw(plot: Axes, with_fixture: list[FloatArray], without: list[FloatArray]) -> None:
    for push in without:
        plot.plot(push[:, 0], push[:, 1], color=_OFF, lw=0.5, ls="--", alpha=0.35)
    for state in MarginState:
        for push in with_fixture:
            shown = push[:, 2] == state
            # Include the first point of the next state, so that the line has no gaps.
            shown[1:] |= shown[:-1]
            here = np.where(shown, push[:, 1], np.nan)
            plot.plot(push[:, 0], here, color=state.color, lw=0.5, alpha=0.8)
    plot.plot(with_fixture[0][:, 0], with_fixture[0][:, 1], color=_INK, lw=1.6)
    if without:
        plot.plot(without[0][:, 0], without[0][:, 1], color=_INK, lw=1.6, ls="--")
    plot.axhline(MARGINS.stop_mm, color=_STOP, lw=1.4)
    plot.axhline(0.0, color=_INK, lw=0.8)
    plot.grid(axis="y", color=_INK, alpha=0.10, lw=0.6)
    for side in ("top", "right"):
        plot.spines[side].set_visible(False)
