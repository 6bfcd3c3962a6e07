"""The gate of one sensor: real hands pass, jumps do not, against an oracle in NumPy and SciPy."""

import io
import math
import os
import subprocess
import sys
from contextlib import redirect_stdout
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from app.case import TrackingFrame, read_recording
from app.geometry import (
    NS_PER_MS,
    NS_PER_S,
    FreshnessLimits,
    InputError,
    Stamp,
    TrackedTransform,
    TrackingStatus,
    Transform,
)
from app.session.pose_tree import PoseRules, PoseTree
from app.session.sensor_motion import (
    CONSISTENT_NS,
    CONSISTENT_SAMPLES,
    MAX_SIGMA_MM,
    MIN_SIGMA_MM,
    SENSOR_MOTION,
    SIGMAS,
    MotionLimits,
    begin_motion,
    jump_of,
    restart_motion,
    update_motion,
)

pytestmark = pytest.mark.slow

LIMITS = MotionLimits()
EDGE = ("tracker", "tool")
RECORDINGS = (
    "EightLandmarkPointsTrackedForPhantomRegistration.igs.mha",
    "ReferenceToRASCalibration.igs.mha",
    "SpinePhantomFreehand.igs.mha",
)


class SensorMotion:
    """The record of one sensor."""

    def __init__(self, limits: MotionLimits) -> None:
        self._state = np.zeros(1, SENSOR_MOTION)
        begin_motion(self._state, limits)

    @property
    def jump(self):
        return jump_of(self._state[0])

    def update(self, pose: Transform, ns: int) -> bool:
        return update_motion(self._state[0], pose.rotation, pose.translation_mm, ns)

    def restart(self) -> None:
        restart_motion(self._state)


def pose(position_mm, rotation_vector=(0.0, 0.0, 0.0)) -> Transform:
    return Transform.from_rotation_vector(
        rotation_vector, np.array(position_mm, dtype=float), target="tracker", source="tool"
    )


def ns(seconds: float) -> int:
    return round(seconds * NS_PER_S)


def at_rest(rate_hz: float, seconds: float, *, sigma_mm: float = 0.15, seed: int = 1):
    """A sensor that has rested for ``seconds``, and the time of its next sample."""
    random = np.random.default_rng(seed)
    sensor, count = SensorMotion(LIMITS), round(seconds * rate_hz)
    for k in range(count):
        turn = random.normal(0.0, math.radians(0.15), 3)
        assert sensor.update(pose(random.normal(0.0, sigma_mm, 3), turn), ns(k / rate_hz))
    return sensor, count / rate_hz


@cache
def tracks(recording):
    """Times and poses of every edge of a recording."""
    found = {}
    for frame in read_recording(recording, lambda note: None):
        for sample in frame.poses:
            if sample.transform is not None:
                edge = found.setdefault(sample.source, [])
                edge.append((sample.stamp.ns, sample.transform))
    return found


def resampled(track, rate_hz, random, *, noise=0.3, stamp_s=0.0, repeats=1, quantum_mm=0.0):
    """The track at another rate with noise in mm and degrees RMS, wrong stamps and repetitions."""
    times = np.array([at_ns for at_ns, _ in track]) / NS_PER_S
    places = np.array([each.translation_mm for _, each in track])
    turns = Slerp(times, Rotation.from_matrix([each.rotation for _, each in track]))
    grid = np.arange(times[0], times[-1], 1.0 / rate_hz)
    scatter = noise / math.sqrt(3.0)
    positions = np.column_stack([np.interp(grid, times, places[:, axis]) for axis in range(3)])
    positions += random.normal(0.0, scatter, positions.shape)
    if quantum_mm:
        positions = np.round(positions / quantum_mm) * quantum_mm
    errors = Rotation.from_rotvec(np.radians(random.normal(0.0, scatter, positions.shape)))
    matrices = (turns(grid) * errors).as_matrix()
    stamps = np.sort(grid + random.uniform(-stamp_s, stamp_s, len(grid)))
    for k, at_s in enumerate(stamps.tolist()):
        held = k - k % repeats
        yield (
            ns(at_s),
            Transform.unchecked("tracker", "tool", matrices[held].copy(), positions[held].copy()),
        )


def refused(track) -> list[str]:
    sensor = SensorMotion(LIMITS)
    return [
        sensor.jump.text
        for at_ns, each in track
        if not sensor.update(each, at_ns) and sensor.jump is not None
    ]


@pytest.mark.parametrize("name", RECORDINGS)
@pytest.mark.parametrize("speed", [1.0, 2.0])
def test_no_pose_of_a_real_recording_is_refused(real_recording, name, speed):
    for track in tracks(real_recording(name)).values():
        first_ns, _ = track[0]
        assert refused((round((at - first_ns) / speed), each) for at, each in track) == []


@pytest.mark.parametrize(
    ("rate_hz", "errors"),
    [
        (20, {"noise": 1.0}),
        (50, {"stamp_s": 0.009}),
        (50, {"quantum_mm": 0.5}),
        (100, {"repeats": 3}),
        (200, {"repeats": 5}),
        (1000, {}),
    ],
)
def test_real_hand_passes_at_other_rates_and_with_errors_of_a_tracker(
    real_recording, rate_hz, errors
):
    random = np.random.default_rng(4)
    stylus = tracks(real_recording(RECORDINGS[0]))["stylus"]
    assert refused(resampled(stylus, rate_hz, random, **errors)) == []


@pytest.mark.parametrize(("rate_hz", "size_mm"), [(15, 100.0), (50, 10.0), (200, 5.0)])
def test_jump_from_rest_is_refused_at_once_and_believed_after_consistent_samples(rate_hz, size_mm):
    sensor, at_s = at_rest(rate_hz, 4.0)
    random = np.random.default_rng(2)
    answers, times = [], []
    for k in range(40):
        place = random.normal(0.0, 0.15, 3) + size_mm * np.array([1.0, 0.0, 0.0])
        times.append(k / rate_hz)
        answers.append(sensor.update(pose(place), ns(at_s + k / rate_hz)))
    first = answers.index(True)
    assert first >= CONSISTENT_SAMPLES
    assert times[first] >= CONSISTENT_NS / NS_PER_S
    assert times[first - 1] < CONSISTENT_NS / NS_PER_S or first == CONSISTENT_SAMPLES
    assert all(answers[first:])


@pytest.mark.parametrize(("rate_hz", "angle_deg"), [(15, 180.0), (50, 180.0), (50, 30.0)])
@pytest.mark.parametrize("axis", np.eye(3).tolist())
def test_turn_from_rest_is_refused_at_once(rate_hz, angle_deg, axis):
    sensor, at_s = at_rest(rate_hz, 4.0)
    turned = pose([0.0, 0.0, 0.0], math.radians(angle_deg) * np.array(axis))
    assert not sensor.update(turned, ns(at_s))
    assert sensor.jump.turned
    assert math.degrees(sensor.jump.off) == pytest.approx(angle_deg, abs=3.0)


def test_turn_at_exactly_the_same_place_is_refused():
    sensor, at_s = at_rest(50.0, 2.0, sigma_mm=0.0)
    assert not sensor.update(pose((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)), ns(at_s))


def test_single_wrong_pose_is_not_used_and_the_old_place_needs_consistent_samples_again():
    sensor, at_s = at_rest(50.0, 2.0)
    assert not sensor.update(pose([100.0, 0.0, 0.0]), ns(at_s))
    answers = [sensor.update(pose([0.01 * k, 0.0, 0.0]), ns(at_s + 0.02 * k)) for k in range(1, 12)]
    assert answers[:CONSISTENT_SAMPLES] == [False] * CONSISTENT_SAMPLES
    assert answers[-1]


def test_sensor_that_keeps_jumping_is_never_believed():
    sensor, at_s = at_rest(50.0, 2.0)
    random = np.random.default_rng(6)
    places = random.uniform(-300.0, 300.0, (200, 3))
    answers = [sensor.update(pose(each), ns(at_s + 0.02 * k)) for k, each in enumerate(places)]
    assert not any(answers)


def test_tool_that_stops_at_once_is_plausible():
    """A tool hits something hard: 600 mm/s, and rest in the next sample."""
    sensor = SensorMotion(LIMITS)
    for k in range(50):
        assert sensor.update(pose([12.0 * k, 0.0, 0.0]), ns(0.02 * k))
    assert sensor.update(pose([12.0 * 49 + 0.4, 0.0, 0.0]), ns(1.0))


def test_repeated_poses_of_a_resting_sensor_do_not_widen_the_gate():
    sensor, at_s = at_rest(50.0, 2.0)
    stuck = pose([0.0, 0.0, 0.0])
    assert all(sensor.update(stuck, ns(at_s + 0.02 * k)) for k in range(40))
    assert not sensor.update(pose([12.0, 0.0, 0.0]), ns(at_s + 0.8))


@pytest.mark.parametrize("gap_s", [0.1, 0.3, 0.6])
def test_gap_widens_the_gate_by_what_a_hand_can_do_meanwhile(gap_s):
    """From rest, a hand with the largest acceleration is at ``a t^2 / 2``, and at most ``v t``."""
    reach_mm = min(0.5 * LIMITS.acceleration_mm_s2 * gap_s**2, 0.98 * LIMITS.speed_mm_s * gap_s)
    inside, at_s = at_rest(50.0, 2.0)
    assert inside.update(pose([reach_mm, 0.0, 0.0]), ns(at_s - 0.02 + gap_s))
    outside, at_s = at_rest(50.0, 2.0)
    beyond_mm = LIMITS.speed_mm_s * (gap_s + 0.02) + 20.0
    assert not outside.update(pose([beyond_mm, 0.0, 0.0]), ns(at_s - 0.02 + gap_s))


def test_any_place_is_plausible_after_a_long_gap_and_after_the_clock_jumped_back():
    sensor, at_s = at_rest(50.0, 2.0)
    assert sensor.update(pose([5000.0, 0.0, 0.0]), ns(at_s + 1.1))
    sensor.restart()
    assert sensor.update(pose([0.0, 0.0, 0.0]), ns(0.5))


def test_gate_agrees_with_an_oracle_that_searches_all_accelerations():
    """A point mass with at most the largest acceleration never leaves the gate, wherever it goes.

    The oracle integrates random piecewise constant accelerations and knows nothing of the gate.
    Far beyond what the mass could reach, with all the noise that the gate allows, it refuses.
    """
    random = np.random.default_rng(9)
    for trial in range(24):
        rate_hz = (15.0, 50.0, 200.0)[trial % 3]
        sensor, dt = SensorMotion(LIMITS), 1.0 / rate_hz
        place, velocity = np.zeros(3), np.zeros(3)
        for k in range(60):
            direction = random.normal(size=3)
            direction /= np.linalg.norm(direction)
            push = random.choice([0.0, 0.3, 1.0]) * LIMITS.acceleration_mm_s2 * direction
            if np.linalg.norm(velocity + push * dt) > 0.8 * LIMITS.speed_mm_s:
                push = np.zeros(3)
            place = place + velocity * dt + 0.5 * push * dt * dt
            velocity = velocity + push * dt
            assert sensor.update(pose(place), ns(k * dt)), (trial, k, sensor.jump)
        window = max(dt, math.ceil(0.02 / dt - 1e-9) * dt)
        ratio = dt / window
        noise = SIGMAS * MAX_SIGMA_MM * math.sqrt(1.0 + (1.0 + ratio) ** 2 + ratio**2)
        # The end of the path, lengthened by the error of stamps, plus all that is tolerated.
        speed = np.linalg.norm(velocity) + 0.5 * LIMITS.acceleration_mm_s2 * window
        reach = 0.5 * LIMITS.acceleration_mm_s2 * dt * (dt + window)
        beyond = speed * (dt + 0.02 * (1.0 + ratio) + 0.01) + reach + noise + 1.0
        away = random.normal(size=3)
        away *= beyond / np.linalg.norm(away)
        assert not sensor.update(pose(place + away), ns(60 * dt))


def test_noise_is_learned_and_bounded():
    quiet, _ = at_rest(50.0, 10.0, sigma_mm=0.001)
    noisy, _ = at_rest(50.0, 10.0, sigma_mm=0.3)
    assert math.sqrt(quiet._state["variance"][0, 0]) == pytest.approx(MIN_SIGMA_MM)
    assert math.sqrt(noisy._state["variance"][0, 0]) == pytest.approx(0.3, rel=0.35)


RULES = """
import numpy as np
from app.case import TrackingFrame
from app.geometry import NS_PER_MS, FreshnessLimits, Stamp, TrackedTransform, Transform
from app.geometry import TrackingStatus
from app.registration import given_registration, largest_tre
from app.session.combined_decision import _keep_nearest, is_narrow
from app.session.joint_check import MEAN_DRIFT, SUDDEN_CHANGE, change_text, mean_text
from app.session.joint_check import update_change, update_mean
from app.session.pose_tree import PoseRules, PoseTree

random, held = np.random.default_rng(3), Transform.identity("tracker", "needle")
registration = given_registration(Transform.identity("tracker", "base"), np.eye(6))
mean, change = np.zeros(1, MEAN_DRIFT)[0], np.zeros(1, SUDDEN_CHANGE)[0]
mean["limit_mm"] = change["limit_mm"] = 1.0
names = ("needle", "tool")
inner = Transform.from_rotation_vector((0.1, 0.2, 0.3), (1, 2, 3), target="tool", source="tip")
outer = inner.renamed(target="tumor", source="needle")
limits = FreshnessLimits(200 * NS_PER_MS, 100 * NS_PER_MS)
tree = PoseTree(PoseRules(limits, names, checked=(names,)))
for k in range(400):
    turn = random.normal(0.0, 0.01, 3) + (k % 150 == 99)
    place = random.normal(0.0, 0.3, 3) + 50.0 * (k % 90 == 80) + 0.1 * k
    now = Stamp((5 * k + k % 3 - 300 * (k > 300)) * NS_PER_MS)
    pose = Transform.from_rotation_vector(turn, place, target="tracker", source="tool")
    if not 150 < k < 290 and (k % 4 or k < 100):
        held = Transform("tracker", "needle", np.eye(3), random.normal(0.0, 0.2, 3).round(1))
    tool, needle = TrackedTransform.valid(pose, now), TrackedTransform.valid(held, now)
    if k % 70 == 60:
        tool = TrackedTransform.lost("tracker", "tool", now, TrackingStatus.OUT_OF_VIEW)
    jumped = tree.insert(TrackingFrame(now, (tool, needle)))
    found = tree.pose("needle", "tool", outer, inner)
    numbers = None if found.transform is None else found.transform.matrix.tolist()
    update_mean(mean, tuple(place.tolist()), now.ns)
    update_change(change, tuple(place.tolist()), (0.1 * k, 0.0, 0.0), mean["start"], now.ns)
    planes, kept = random.normal(0.0, 3.0, (12, 10)).round(1), np.arange(8)
    left_out_mm, narrow = _keep_nearest(planes, kept), is_narrow(planes, [0, 1, 2] * 4)
    tre_mm = largest_tre(registration, pose, pose, planes[:, 1:4])
    print(len(tree.accepted.poses) == 2, tree.implausible(), sorted(jumped), numbers)
    print(found.oldest, found.unchanged_ns, sorted(found.problems))
    print(mean["exceeded"], mean_text(mean))
    print(narrow, kept, left_out_mm, tre_mm, change["found"], change_text(change))
"""


def test_compiled_rules_find_the_same_as_plain_python():
    compiled = io.StringIO()
    with redirect_stdout(compiled):
        exec(RULES, {})
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    command = [sys.executable, "-c", RULES]
    plain = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert plain.stdout == compiled.getvalue()
    for word in (
        "True {",
        "False {",
        "jumps by",
        "turns by",
        "clock_jumped_back",
        "frozen",
        "missing",
    ):
        assert word in plain.stdout


def test_text_names_size_time_and_limit():
    sensor, at_s = at_rest(50.0, 4.0)
    sensor.update(pose([100.0, 0.0, 0.0]), ns(at_s))
    text = sensor.jump.text
    assert text.startswith(("jumps by 99", "jumps by 100", "jumps by 101"))
    assert "mm within 20 ms; expected at most " in text


class Checked:
    """A sensor at rest at 50 Hz, whose frames a `PoseTree` has seen for two seconds."""

    def __init__(self):
        rules = PoseRules(FreshnessLimits(NS_PER_S), (), checked=(EDGE,))
        self.poses, self.now_ns = PoseTree(rules), NS_PER_S
        random = np.random.default_rng(4)
        for _ in range(100):
            assert self.passes(random.normal(0.0, 0.15, 3))

    def passes(self, position_mm, ahead_ms=0.0):
        """True if a pose of the next frame, stamped ``ahead_ms`` after it, may be used."""
        self.now_ns += 20 * NS_PER_MS
        stamp = Stamp(self.now_ns + round(ahead_ms * NS_PER_MS))
        sample = TrackedTransform(pose(position_mm), stamp, TrackingStatus.OK)
        frame = TrackingFrame(Stamp(self.now_ns), (sample,))
        self.poses.insert(frame)
        return self.poses.accepted.poses == (sample,)


def test_stamp_of_the_future_gives_a_jump_no_time():
    assert not Checked().passes([30.0, 0.0, 0.0], ahead_ms=500.0)


def test_sample_after_one_of_the_future_is_checked():
    sensor = Checked()
    assert sensor.passes([0.0, 0.0, 0.0], ahead_ms=500.0)
    assert not sensor.passes([30.0, 0.0, 0.0])


def test_late_sample_is_not_used_and_teaches_nothing():
    sensor = Checked()
    assert not sensor.passes([30.0, 0.0, 0.0], ahead_ms=-25.0)
    assert sensor.passes([0.0, 0.0, 0.0])
    assert not sensor.passes([30.0, 0.0, 0.0])


def test_late_sample_from_before_a_refused_pose_is_not_used():
    sensor = Checked()
    assert not sensor.passes([30.0, 0.0, 0.0])
    assert not sensor.passes([30.0, 0.0, 0.0], ahead_ms=-30.0)
    found = sensor.poses.pose(*EDGE)
    assert found.oldest == Stamp(sensor.now_ns - 40 * NS_PER_MS)
    assert abs(found.transform.translation_mm).max() < 1.0


@pytest.mark.parametrize("name", ["speed_mm_s", "acceleration_rad_s2"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_limits_are_finite_and_positive(name, value):
    with pytest.raises(InputError, match=f"{name} of the motion limits is "):
        MotionLimits(**{name: value})


def test_update_is_cheap_enough_for_a_step_at_1_khz():
    """Counted in calls of Python functions, which does not depend on the machine."""
    import cProfile
    import pstats

    sensor, at_s = at_rest(1000.0, 1.0)
    profile = cProfile.Profile()
    poses = [pose(np.random.default_rng(k).normal(0.0, 0.15, 3)) for k in range(100)]
    profile.enable()
    for k, each in enumerate(poses):
        sensor.update(each, ns(at_s) + k * NS_PER_MS)
    profile.disable()
    assert pstats.Stats(profile).total_calls < 100 * 60
