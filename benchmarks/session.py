"""Duration of one session step at 1 kHz, from a tracker frame to a decision.

Uses the recorded case's tumour, tool, robot and registration, with frames interpolated to 1 kHz.
Steps are paced by an absolute clock; a bare loop with the same pacing shows the latency of the
machine itself. The goal of a step is one of CPU time of its thread; on an idle machine wall time is
the same.
"""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from app.case import JointSample, TrackingFrame
from app.cli.progress import announce_duration
from app.fixture import MarginState, Proximity, SweptProximity
from app.geometry import NS_PER_S, FloatArray, Stamp, TrackedTransform, TrackingStatus, Transform
from app.runtime import prepare_case
from app.session import ProximityModel, Session, SessionSetup
from benchmarks.harness.figures import figures_table, show, spread
from benchmarks.harness.goals import Goal, at_most, finish
from benchmarks.harness.options import BenchParser
from benchmarks.harness.peer import paced, to_and_fro
from benchmarks.harness.processes import resident_mb

RATE_HZ = 1000
MAX_STEP_MS = 1.0
MAX_GROWTH_MB = 2.0
WARM_UP = 0.1  # share of the run after which memory is expected to be constant
_PERIOD_NS = NS_PER_S // RATE_HZ
_BARE_S = 5.0
_MEMORY_EVERY = RATE_HZ // 2


class Trajectory:
    """Frames at ``rate_hz`` along the poses and joints of ``recorded``, forwards and backwards.

    Positions and joints are interpolated linearly, rotations along the shortest arc. Times are on
    the recording's clock from its first stamp on and never go back. All values are computed in the
    constructor, so that a frame only costs its own objects.
    """

    def __init__(self, recorded: Sequence[TrackingFrame], rate_hz: int) -> None:
        self._clock = recorded[0].stamp.clock
        self._period_ns = NS_PER_S // rate_hz
        samples: dict[tuple[str, str], list[TrackedTransform]] = {}
        for frame in recorded:
            for sample in frame.poses:
                if sample.status is TrackingStatus.OK:
                    samples.setdefault((sample.target, sample.source), []).append(sample)
        joints = [sample for frame in recorded for sample in frame.joints]
        # Only the time in which all edges and the joints are known: no extrapolation.
        every = [[sample.stamp.ns for sample in edge] for edge in samples.values()]
        every += [[sample.stamp.ns for sample in joints]] if joints else []
        self._start_ns = max(times[0] for times in every)
        times_ns = np.arange(self._start_ns, min(times[-1] for times in every) + 1, self._period_ns)
        self._count = len(times_ns)
        self._edges = {edge: _interpolated(found, times_ns) for edge, found in samples.items()}
        self._joint_names = joints[0].names if joints else ()
        known_ns = np.array([sample.stamp.ns for sample in joints])
        axes = zip(*(sample.positions for sample in joints), strict=True)
        self._joints = np.array([np.interp(times_ns, known_ns, axis) for axis in axes]).T

    def frames(self, count: int) -> Iterator[TrackingFrame]:
        for k in range(count):
            at = to_and_fro(k, self._count)
            stamp = Stamp(self._start_ns + k * self._period_ns, self._clock)
            poses = tuple(
                TrackedTransform.valid(
                    Transform.from_quaternion(
                        quaternions[at], positions[at], target=target, source=source
                    ),
                    stamp,
                )
                for (target, source), (positions, quaternions) in self._edges.items()
            )
            names = self._joint_names
            joints = (JointSample(names, self._joints[at], stamp),) if names else ()
            yield TrackingFrame(stamp, poses, joints)


def _interpolated(
    samples: list[TrackedTransform], times_ns: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Positions (n, 3) in mm and quaternions (n, 4), x y z w, at ``times_ns``."""
    poses = [sample.transform for sample in samples if sample.transform is not None]
    known_ns = np.array([sample.stamp.ns for sample in samples])
    known_mm = np.array([pose.translation_mm for pose in poses])
    positions = [np.interp(times_ns, known_ns, known_mm[:, axis]) for axis in range(3)]
    rotations = Slerp(
        known_ns - known_ns[0], Rotation.from_matrix([pose.rotation for pose in poses])
    )
    return np.column_stack(positions), rotations(times_ns - known_ns[0]).as_quat()


class TimedModel:
    """A proximity model that sums the CPU time of its evaluations and sweeps."""

    def __init__(self, model: ProximityModel) -> None:
        self._model = model
        self.radius_mm = model.radius_mm
        self.frames = model.frames
        self.cpu_ns = 0

    def evaluate(self, tumor_from_tool: Transform, stamp: Stamp | None = None) -> Proximity:
        return self._timed(self._model.evaluate, tumor_from_tool, stamp)

    def sweep(
        self, previous: Transform, current: Transform, stamp: Stamp | None = None
    ) -> SweptProximity:
        return self._timed(self._model.sweep, previous, current, stamp)

    def _timed(self, method: Callable[..., Any], *arguments: object) -> Any:
        begin = time.thread_time_ns()
        try:
            return method(*arguments)
        finally:
            self.cpu_ns += time.thread_time_ns() - begin


class Stepping:
    """Runs one timed session step per cycle; building the frame is not timed."""

    def __init__(self, setup: SessionSetup, frames: Iterator[TrackingFrame], count: int) -> None:
        self._model = TimedModel(setup.proximity)
        self._session = Session(replace(setup, proximity=self._model))
        self._frames = frames
        # Filled, so that the operating system maps the pages before the run.
        self.cpu_ns, self.wall_ns = np.full(count, -1.0), np.full(count, -1.0)
        self.model_ns = np.full(count, -1.0)
        self.rss_mb = np.full(-(-count // _MEMORY_EVERY), -1.0)
        self.states = dict.fromkeys(MarginState, 0)

    def cycle(self, k: int) -> None:
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


def measure(setup: SessionSetup, source: Trajectory, count: int) -> dict[str, Any]:
    """Run the bare loop, then ``count`` session steps.

    Of a step, ``model_cpu`` is the proximity model's part and ``rest_cpu`` everything else.
    ``late`` is the delay of a cycle's start after its due time.
    """
    stepping = Stepping(setup, source.frames(count), count)
    start_mb = resident_mb()
    bare_count = min(count, int(_BARE_S * RATE_HZ))
    bare_late = paced(bare_count, _PERIOD_NS, lambda k: None)
    late = paced(count, _PERIOD_NS, stepping.cycle)
    warm = int(WARM_UP * len(stepping.rss_mb)) + 1
    rss_mb = stepping.rss_mb[warm - 1 :]
    minutes = np.arange(len(rss_mb)) * _MEMORY_EVERY / RATE_HZ / 60.0
    durations_ns = {
        "step_cpu": stepping.cpu_ns,
        "model_cpu": stepping.model_ns,
        "rest_cpu": stepping.cpu_ns - stepping.model_ns,
        "step_wall": stepping.wall_ns,
        "late": np.array(late),
        "bare_late": np.array(bare_late),
    }
    return {
        "steps": count,
        **{name: spread(each / 1e6) for name, each in durations_ns.items()},
        "memory": {
            "start_mb": start_mb,
            "warm_mb": float(rss_mb[0]),
            "end_mb": float(rss_mb[-1]),
            "slope_mb_min": float(np.polyfit(minutes, rss_mb, 1)[0]) if len(rss_mb) > 1 else np.nan,
        },
        "states": {state.name: number for state, number in stepping.states.items()},
    }


def goals(found: Mapping[str, Any]) -> Iterator[Goal]:
    growth_mb = found["memory"]["end_mb"] - found["memory"]["warm_mb"]
    yield at_most("step p99 is", found["step_cpu"]["p99_ms"], MAX_STEP_MS, "ms", ".3f")
    yield at_most("memory grew by", growth_mb, MAX_GROWTH_MB, "MB", ".2f")


def main() -> int:
    parser = BenchParser("session", __doc__)
    parser.number("--seconds", 60.0, "how long")
    parser.case()
    options = parser.parse_args()
    prepared = prepare_case(options.case)
    source = Trajectory(list(prepared.case.frames()), RATE_HZ)
    announce_duration("stepping", options.seconds + min(options.seconds, _BARE_S))
    found = measure(prepared.setup, source, max(1, round(options.seconds * RATE_HZ)))
    show(figures_table(found))
    return finish(options.json, found, goals(found))
