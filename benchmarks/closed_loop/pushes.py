"""Pushes from random directions, each judged by the truth of every physics step."""

import time
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from app.fixture import ProximityEngine
from app.geometry import NS_PER_MS
from benchmarks.closed_loop.hand import STOP_MM, Phase
from benchmarks.closed_loop.loop_operator import Operator
from benchmarks.closed_loop.processes import running_loop
from benchmarks.closed_loop.truth import STILL_MM_S, Surfaces, Truth

SETTLED_NS = 100 * NS_PER_MS  # time after the beginning of a phase, after which its speed counts
MAX_TRIES = 3
OTHER_DIRECTION = 100_000  # added to the number of a push that is tried again


def run_pushes(
    folder: Path,
    operator: Operator,
    *,
    count: int,
    seed: int,
    fixture: bool,
    base_error: bool = False,
) -> tuple[list[dict[str, Any]], dict[str, float]]:
    """Run ``count`` pushes in one loop, and judge them.

    Number and seed give the direction of a push. One that did not begin beside the tumour, because
    the arm stood, is tried again from another direction. Also returns the processor time per time
    of each process, 1 is a core. Raises `ChildError` for a lost process.
    """
    done: dict[int, tuple[tuple[int, int], Counter[str]]] = {}
    with running_loop(folder, operator, seed, fixture=fixture, base_error=base_error) as loop:
        loop.follows()
        began_s, began_cpu_s, lags = time.monotonic(), loop.cpu_s(), 0
        for number in range(count):
            for attempt in range(MAX_TRIES):
                loop.follows()
                before = operator.stops()
                loop.physics.send(do="push", number=number + attempt * OTHER_DIRECTION)
                while (event := loop.next_event())["event"] != "pushed":
                    pass
                stops = operator.stops() - before
                stops["lags"], lags = event["lags"] - lags, event["lags"]
                if event["reached"]:
                    done[number] = (event["rows"][0], event["rows"][1]), +stops
                    break
        spent_s = time.monotonic() - began_s
        cpu = {name: (s - began_cpu_s[name]) / spent_s for name, s in loop.cpu_s().items()}
        loop.end()
    surfaces = Surfaces.shipped()
    truth = Truth(loop.truth_file)
    engine = ProximityEngine(surfaces.tumor, surfaces.tool)
    pushes = [
        judged(number, fixture, truth, engine, surfaces, rows, stops)
        for number, (rows, stops) in done.items()
    ]
    return pushes, cpu


def judged(
    number: int,
    fixture: bool,
    truth: Truth,
    engine: ProximityEngine,
    surfaces: Surfaces,
    rows: tuple[int, int],
    stops: Mapping[str, int],
) -> dict[str, Any]:
    """A push: true distances in mm, and speeds of the tip in mm/s.

    ``lowest_mm`` is by the product's engine at every step from the beginning of the push to the end
    of the retreat, ``vertices_mm`` by libigl at every one, from the vertices of both surfaces.
    ``breach_mm`` is the lowest one below the stop margin at which the tool's own motion reduces the
    distance by more than `STILL_MM_S`, None without one: a tumour that breathes also approaches a
    tool that stands. ``approach_mm_s`` is the largest speed of the push, ``slide_mm_s`` and
    ``retreat_mm_s`` the median ones. ``stops``: number of safe stops meanwhile, each of which
    interrupts the push, by cause: the reason of the controller, ``arm stood`` (FAULT, or no command
    for 30 ms) and ``lags``, a physics that has fallen behind.
    """
    first, _ = truth.phase_rows(*rows, Phase.PUSH)
    distances = truth.distances_mm(engine, first, rows[1])
    push, slide, retreat = (
        truth.phase_rows(*rows, phase) for phase in (Phase.PUSH, Phase.SLIDE, Phase.RETREAT)
    )
    breaches = [
        float(distances[row])
        for row in np.flatnonzero(distances < STOP_MM).tolist()
        if truth.own_approach_mm_s(engine, first + row) > STILL_MM_S
    ]
    disabled = int(np.count_nonzero(np.diff(truth.enabled[first : rows[1]].astype(int)) < 0))
    causes = {**stops, "arm stood": disabled} if disabled else dict(stops)
    poses = [truth.tumor_from_tool(row) for row in range(first, rows[1])]
    return {
        "number": number,
        "fixture": fixture,
        "lowest_mm": float(distances.min()),
        "breach_mm": min(breaches, default=None),
        "vertices_mm": surfaces.lowest_vertex_mm(poses),
        "approach_mm_s": float(truth.speeds_mm_s(*push).max(initial=0.0)),
        "slide_mm_s": _settled(truth, truth.speeds_mm_s(*slide), slide),
        "retreat_mm_s": _settled(truth, truth.speeds_mm_s(*retreat), retreat),
        "stops": causes,
    }


def _settled(truth: Truth, speeds: np.ndarray, rows: tuple[int, int]) -> float:
    """Median speed of a phase without its beginning."""
    ns = truth.ns[rows[0] : rows[1]]
    late = ns - ns[0] > SETTLED_NS if len(ns) else np.zeros(0, dtype=bool)
    return float(np.median(speeds[late])) if late.any() else 0.0
