"""Processor time of one session step beside FCL's distance of whole meshes, in turns.

A step leads from a tracker frame to a decision. Frames are interpolated from the recorded case, at
1 kHz from its middle on, and from the case with three structures. FCL's distance is that of
`bench fixture`: a tumour of 81,920 triangles and a tool of 2k, near its surface. A live step also
computes how far the tool may move, and does not measure what is far. Times are processor times of
the thread.
"""

import gc
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import islice
from typing import Any, TypeAlias

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from app.case import JointSample, TrackingFrame
from app.geometry import NS_PER_S, FloatArray, Stamp, TrackedTransform, TrackingStatus, Transform
from app.runtime import prepare_case
from app.session import Session
from benchmarks.fixture.case import Case
from benchmarks.fixture.engines import ENGINES
from benchmarks.harness.figures import columns_table, figures_table, in_turns, show, spread
from benchmarks.harness.goals import Goal, at_most, finish
from benchmarks.harness.options import RECORDED_CASE, BenchParser
from benchmarks.harness.peer import to_and_fro
from benchmarks.harness.processes import resident_mb

LIVE, THREE, FCL = "live, 40 Hz", "live, 40 Hz, three structures", "FCL, distance"
MOST_P50, MOST_P99, MOST_THREE = 0.15, 0.45, 2.0
"""Goals in FCL's median, and of three structures in the median of one."""
MAX_GROWTH_MB = 2.0
_STRUCTURES_CASE = RECORDED_CASE.with_name("structures_case")
_TRIANGLES = (81_920, 2000)
_WARM_ROUNDS, _ROUNDS = 2, 20
_STEPS_TO_ONE_QUERY = 5

Peer: TypeAlias = tuple[Callable[[Any], Any], Iterator[Any]]
"""A function, and its inputs."""


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


def measure(peers: Mapping[str, Peer], steps: int) -> dict[str, Any]:
    """Percentiles of about ``steps`` steps of each of the ``peers``, and the growth of memory.

    ``p50`` and ``p99`` are in the median of `FCL`, which is called less often. Making the inputs is
    not timed.
    """
    times_ns: dict[str, list[list[int]]] = {name: [] for name in peers}
    states, resident = Counter[str](), [0.0]
    gc.collect()
    gc.freeze()
    for name in in_turns(list(peers), _WARM_ROUNDS + _ROUNDS, "steps"):
        call, inputs = peers[name]
        count = max(_STEPS_TO_ONE_QUERY, steps // _ROUNDS)
        spent_ns = []
        for each in islice(inputs, count // _STEPS_TO_ONE_QUERY if name == FCL else count):
            begin = time.thread_time_ns()
            found = call(each)
            spent_ns.append(time.thread_time_ns() - begin)
            if name != FCL:
                states[found.decision.state.name] += 1
        times_ns[name].append(spent_ns)
        resident.append(resident_mb())
    figures = {
        name: spread(np.concatenate(rounds[_WARM_ROUNDS:]) / 1e6)
        for name, rounds in times_ns.items()
    }
    yard_ms = figures[FCL]["p50_ms"]
    return {
        "forms": [
            {"form": name, **each, "p50": each["p50_ms"] / yard_ms, "p99": each["p99_ms"] / yard_ms}
            for name, each in figures.items()
        ],
        "memory": {"warm_mb": resident[_WARM_ROUNDS * len(peers)], "end_mb": resident[-1]},
        "states": states,
    }


def goals(found: Mapping[str, Any]) -> Iterator[Goal]:
    forms = {each["form"]: each for each in found["forms"]}
    for name, each in forms.items():
        if name not in (FCL, THREE):
            yield at_most(f"p50 of {name}, in FCL's, is", each["p50"], MOST_P50, digits=".3f")
            yield at_most(f"p99 of {name}, in FCL's p50, is", each["p99"], MOST_P99, digits=".3f")
    ratio = forms[THREE]["p50"] / forms[LIVE]["p50"]
    yield at_most("p50 with three structures, in that of one, is", ratio, MOST_THREE, digits=".2f")
    growth_mb = found["memory"]["end_mb"] - found["memory"]["warm_mb"]
    yield at_most("memory grew by", growth_mb, MAX_GROWTH_MB, "MB", ".2f")


def main() -> int:
    parser = BenchParser("session", __doc__)
    parser.number("--steps", 10_000, "of each form", low=100)
    parser.gone("--seconds", expected="--steps")
    parser.case()
    options = parser.parse_args()
    one, three = prepare_case(options.case), prepare_case(_STRUCTURES_CASE)
    peers: dict[str, Peer] = {}
    for name, case, rate_hz, is_live in (
        (LIVE, one, 40, True),
        ("live, 1 kHz", one, 1000, True),
        ("replay, 1 kHz", one, 1000, False),
        (THREE, three, 40, True),
    ):
        recorded = list(case.case.frames())
        start = 0 if rate_hz == 40 else len(recorded) // 2
        session = Session(case.setup, free_motion=is_live, skip_far=is_live)
        peers[name] = session.step, Trajectory(recorded[start:], rate_hz).frames(2 * options.steps)
    meshes = Case.of(*_TRIANGLES, options.steps)
    peers[FCL] = ENGINES["fcl"].build(meshes.tumor, meshes.tool), iter(meshes.trajectory)
    found = measure(peers, options.steps)
    columns = {name: name for name in ("form", "p50_ms", "p99_ms", "max_ms")}
    columns |= {"p50 in FCL's": "p50", "p99 in FCL's p50": "p99"}
    show(columns_table("steps", found["forms"], columns), figures_table(found))
    return finish(options.json, found, goals(found))
