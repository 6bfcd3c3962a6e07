"""Processes that are killed or stopped in the middle of an approach: how soon the arm stands."""

import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from app.fixture import ProximityEngine
from app.geometry import NS_PER_MS, NS_PER_S
from benchmarks.closed_loop.loop_operator import Operator
from benchmarks.closed_loop.processes import running_loop
from benchmarks.closed_loop.truth import STILL_MM_S, Surfaces, Truth

STALE_MS = 100.0  # ``stale_after_ms`` of the shipped live.yaml: the age limit of a constraint
COMMAND_MS = 30.0  # age limit of a command at the arm
ALLOWED_MS = 30.0  # time beyond the age limit in which the arm has to stand
WATCH_S = 1.0
LONG_PUSH_S = 5.0  # on while the arm is watched: another force deflects standing drives by 0.2 mm
LIMITS_MS = {"guard": STALE_MS, "tracker": STALE_MS, "controller": COMMAND_MS}  # by process
SIGNALS = (signal.SIGKILL, signal.SIGSTOP)
MAX_TRIES = 4


@dataclass(frozen=True, slots=True)
class Stop:
    """One failure: the speed before it, and when the tip was below 1 mm/s for the rest of 1 s.

    ``still_ms`` is counted from the signal, None if it was not still. ``lowest_mm``: the lowest
    true distance from the signal on, also by the tumour's breath. ``again_mm``: how far the tip
    goes in the second after a stopped process goes on, None for a killed one. ``tries``: failures
    that were not counted, because something else had stopped the arm, such as a physics behind real
    time.
    """

    process: str
    signal: str
    speed_mm_s: float
    still_ms: float | None
    limit_ms: float
    lowest_mm: float
    again_mm: float | None
    tries: int

    @property
    def is_safe(self) -> bool:
        return self.still_ms is not None and self.still_ms <= self.limit_ms + ALLOWED_MS


def run_stop(
    folder: Path, operator: Operator, *, process: str, number: signal.Signals, seed: int
) -> Stop | None:
    """Let ``process`` fail in the middle of an approach; None if that could not be measured."""
    for attempt in range(MAX_TRIES):
        found = _try_stop(folder / str(attempt), operator, process, number, seed + attempt, attempt)
        if found is not None:
            return found
    return None


def _try_stop(
    folder: Path, operator: Operator, process: str, number: signal.Signals, seed: int, tries: int
) -> Stop | None:
    operator.rearming.set()
    with running_loop(folder, operator, seed, fixture=True) as loop:
        if not loop.follows():
            return None
        loop.physics.send(do="push", number=tries, push_s=LONG_PUSH_S)
        if loop.next_event()["event"] != "mid":
            return None
        child = loop.children[process].process
        os.kill(child.pid, number)
        failed_ns = time.time_ns()
        operator.rearming.clear()
        time.sleep(WATCH_S)
        continued_ns = None
        if number is signal.SIGSTOP:
            os.kill(child.pid, signal.SIGCONT)
            continued_ns = time.time_ns()
            time.sleep(WATCH_S)
        loop.end()
    truth = Truth(loop.truth_file)
    first = int(np.searchsorted(truth.ns, failed_ns))
    last = int(np.searchsorted(truth.ns, failed_ns + round(WATCH_S * NS_PER_S)))
    gaps = np.diff(truth.ns[max(0, first - 50) : last])
    speeds = truth.speeds_mm_s(first, last)
    if last - first < 100 or gaps.max() > 30 * NS_PER_MS or speeds[0] < 10.0:
        return None  # the physics was not in real time, or the arm stood before
    moving = np.flatnonzero(speeds >= STILL_MM_S)
    still_ms = None
    if moving[-1] < len(speeds) - 1:
        still_ms = float(truth.ns[first + moving[-1] + 1] - failed_ns) / NS_PER_MS
    surfaces = Surfaces.shipped()
    engine = ProximityEngine(surfaces.tumor, surfaces.tool)
    again = None
    if continued_ns is not None:
        again = truth.path_mm(int(np.searchsorted(truth.ns, continued_ns)))
    return Stop(
        process,
        number.name,
        float(speeds[0]),
        still_ms,
        LIMITS_MS[process],
        float(truth.distances_mm(engine, first, len(truth.ns)).min()),
        again,
        tries,
    )
