"""How long one step of a session takes at 1 kHz: a tracker frame in, a decision out.

    marginguard bench session [--seconds 60] [--case data/recorded_case] [--json FILE]

The recorded case's tumour, tool, robot and registration, with its frames interpolated to 1 kHz.
Steps are paced by an absolute clock; a bare loop, paced alike in the same run, shows how late the
machine itself makes a cycle. Exit status 1 when the 99th percentile of a step, in CPU time of its
thread, is above 1 ms, or when the resident memory grows by more than 2 MB after the warm-up. Wall
time is shown beside: on a machine that does nothing else it is the same.
"""

import json
import os
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from app.case import TrackingFrame
from app.fixture import MarginState, Proximity, SweptProximity
from app.geometry import FloatArray, Stamp, Transform
from app.runtime import prepare_case
from app.session import ProximityModel, Session, SessionSetup
from benchmarks.case_options import case_options
from benchmarks.session_trajectory import Trajectory

RATE_HZ = 1000
MOST_STEP_MS = 1.0
MOST_GROWTH_MB = 2.0
WARM_UP = 0.1
"""Share of the run after which memory is expected to stay where it is."""

_PERIOD_NS = 1_000_000_000 // RATE_HZ
_BARE_S = 5.0
_MEMORY_EVERY = RATE_HZ // 2


@dataclass(frozen=True, slots=True)
class Spread:
    """Median, 99th percentile and largest, in ms."""

    p50_ms: float
    p99_ms: float
    max_ms: float

    @classmethod
    def of(cls, ns: FloatArray) -> "Spread":
        """Of durations (n,) in ns."""
        return cls(*(float(value) for value in np.percentile(ns / 1e6, [50, 99, 100])))


@dataclass(frozen=True, slots=True)
class Memory:
    """Resident memory in MB: at the start, after the warm-up, at the end, and how it grows."""

    start_mb: float
    warm_mb: float
    end_mb: float
    slope_mb_min: float


@dataclass(frozen=True, slots=True)
class Figures:
    """What one run showed.

    ``model_cpu`` is the proximity model's part of a step, ``rest_cpu`` everything else. ``late`` is
    how long after its time a cycle began.
    """

    steps: int
    step_cpu: Spread
    model_cpu: Spread
    rest_cpu: Spread
    step_wall: Spread
    late: Spread
    bare_late: Spread
    memory: Memory
    states: dict[str, int]


def paced(count: int, cycle: Callable[[int], None]) -> FloatArray:
    """Call ``cycle`` at `RATE_HZ` on an absolute clock; how late each call was, in ns.

    A cycle that takes too long makes the next ones late, and none is left out.
    """
    late = np.zeros(count)
    begin = time.perf_counter_ns()
    for k in range(count):
        due = begin + k * _PERIOD_NS
        ahead = due - time.perf_counter_ns()
        if ahead > 0:
            time.sleep(ahead / 1e9)
        late[k] = time.perf_counter_ns() - due
        cycle(k)
    return late


class TimedModel:
    """A proximity model that adds up the CPU time of its evaluations and sweeps."""

    def __init__(self, model: ProximityModel) -> None:
        self._model = model
        self.radius_mm = model.radius_mm
        self.frames = model.frames
        self.cpu_ns = 0

    def evaluate(self, tumor_from_tool: Transform, stamp: Stamp | None = None) -> Proximity:
        """What the model finds at this pose."""
        begin = time.thread_time_ns()
        found = self._model.evaluate(tumor_from_tool, stamp)
        self.cpu_ns += time.thread_time_ns() - begin
        return found

    def sweep(
        self, previous: Transform, current: Transform, stamp: Stamp | None = None
    ) -> SweptProximity:
        """What the model finds on the way."""
        begin = time.thread_time_ns()
        found = self._model.sweep(previous, current, stamp)
        self.cpu_ns += time.thread_time_ns() - begin
        return found


class Stepping:
    """One step of a session a cycle, timed; its frame is made outside of what is timed."""

    def __init__(self, setup: SessionSetup, frames: Iterator[TrackingFrame], count: int) -> None:
        self._model = TimedModel(setup.proximity)
        self._session = Session(replace(setup, proximity=self._model))
        self._frames = frames
        # Written to here, so that the operating system gives the pages before the run.
        self.cpu_ns, self.wall_ns = np.full(count, -1.0), np.full(count, -1.0)
        self.model_ns = np.full(count, -1.0)
        self.rss_mb = np.full(-(-count // _MEMORY_EVERY), -1.0)
        self.states = dict.fromkeys(MarginState, 0)

    def cycle(self, k: int) -> None:
        """The ``k``-th cycle: the next frame is made, then the step taken and timed."""
        frame = next(self._frames)
        self._model.cpu_ns = 0
        wall, cpu = time.perf_counter_ns(), time.thread_time_ns()
        step = self._session.step(frame)
        self.cpu_ns[k] = time.thread_time_ns() - cpu
        self.wall_ns[k] = time.perf_counter_ns() - wall
        self.model_ns[k] = self._model.cpu_ns
        self.states[step.decision.state] += 1
        if k % _MEMORY_EVERY == 0:
            self.rss_mb[k // _MEMORY_EVERY] = resident_mb()


def resident_mb() -> float:
    """The resident memory of this process, as the kernel counts it."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def measure(setup: SessionSetup, source: Trajectory, count: int) -> Figures:
    """Run the bare loop, then ``count`` steps of a session."""
    stepping = Stepping(setup, source.frames(count), count)
    start_mb = resident_mb()
    bare_late = paced(min(count, int(_BARE_S * RATE_HZ)), lambda k: None)
    late = paced(count, stepping.cycle)
    warm = int(WARM_UP * len(stepping.rss_mb)) + 1
    rss_mb = stepping.rss_mb[warm - 1 :]
    minutes = np.arange(len(rss_mb)) * _MEMORY_EVERY / RATE_HZ / 60.0
    slope = float(np.polyfit(minutes, rss_mb, 1)[0]) if len(rss_mb) > 1 else float("nan")
    return Figures(
        steps=count,
        step_cpu=Spread.of(stepping.cpu_ns),
        model_cpu=Spread.of(stepping.model_ns),
        rest_cpu=Spread.of(stepping.cpu_ns - stepping.model_ns),
        step_wall=Spread.of(stepping.wall_ns),
        late=Spread.of(late),
        bare_late=Spread.of(bare_late),
        memory=Memory(start_mb, float(rss_mb[0]), float(rss_mb[-1]), slope),
        states={state.name: number for state, number in stepping.states.items()},
    )


def failures(figures: Figures) -> list[str]:
    """What is not as it is wanted, one sentence each."""
    found = []
    if figures.step_cpu.p99_ms > MOST_STEP_MS:
        found.append(f"step p99 is {figures.step_cpu.p99_ms:.3f} ms, {MOST_STEP_MS} ms wanted")
    growth_mb = figures.memory.end_mb - figures.memory.warm_mb
    if growth_mb > MOST_GROWTH_MB:
        found.append(f"memory grew by {growth_mb:.2f} MB, {MOST_GROWTH_MB} MB allowed")
    return found


def main() -> int:
    options = case_options("session", __doc__)
    prepared = prepare_case(options.case)
    source = Trajectory(list(prepared.case.frames()), RATE_HZ)
    figures = measure(prepared.setup, source, max(1, round(options.seconds * RATE_HZ)))
    print(f"{figures.steps} steps at {RATE_HZ} Hz      p50 ms   p99 ms   max ms")
    for name, spread in (
        ("step, thread CPU time", figures.step_cpu),
        ("  of it proximity", figures.model_cpu),
        ("  of it the rest", figures.rest_cpu),
        ("step, wall time", figures.step_wall),
        ("cycle begins late by", figures.late),
        ("bare loop late by", figures.bare_late),
    ):
        print(f"  {name:<24}{spread.p50_ms:>9.3f}{spread.p99_ms:>9.3f}{spread.max_ms:>9.3f}")
    memory = figures.memory
    print(
        f"  resident memory: {memory.start_mb:.2f} MB at the start, {memory.warm_mb:.2f} MB after "
        f"the warm-up, {memory.end_mb:.2f} MB at the end, {memory.slope_mb_min:+.3f} MB/min"
    )
    print("  states: " + ", ".join(f"{name} {count}" for name, count in figures.states.items()))
    wrong = failures(figures)
    if options.json is not None:
        options.json.write_text(json.dumps({**asdict(figures), "failures": wrong}, indent=1) + "\n")
    for sentence in wrong:
        print(sentence, file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    raise SystemExit(main())
