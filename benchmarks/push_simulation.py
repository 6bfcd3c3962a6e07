"""Simulation of a hand that pushes a robot-held tool towards a tumour.

The fixture is that of the product, at 1 kHz: `TumorMotionFilter`, `ProximityEngine`,
`RecentWitnesses`, `MarginMonitor`, `limit_twist`. Its inputs are the robot's encoders and a tracker
with delay, a low rate and noise. The true distance is measured independently of them.
"""

import math
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from app.fixture import (
    AdmittanceParameters,
    AdmittanceTool,
    Constraint,
    FixtureDecision,
    LimiterParameters,
    MarginMonitor,
    MarginObservation,
    MarginParameters,
    MarginState,
    ProximityEngine,
    RecentWitnesses,
    TumorMotionFilter,
    TumorMotionParameters,
    limit_twist,
)
from app.geometry import NS_PER_MS, NS_PER_S, FloatArray, Stamp, Transform

STEP_NS = NS_PER_MS
TRUTH_EVERY = 5
"""Number of steps between two measurements of the true distance, which changes slowly."""

MARGINS = MarginParameters(
    stop_mm=1.0,
    warn_mm=5.0,
    k_tre=3.0,
    # The tool's pose comes from its encoders, so only the tumour moves between samples.
    v_max_mm_s=10.0,
    stale_after_ns=200 * NS_PER_MS,
    release_samples=5,
    release_band_mm=0.2,
    frozen_after_ns=NS_PER_S,
)
LIMITER = LimiterParameters(tau_s=0.05, lever_mm=50.0, retreat_mm_s=20.0)
HAND = AdmittanceParameters(
    linear_mm_s_n=10.0,
    angular_rad_s_nm=2.0,
    handle_mm=(0.0, 0.0, -80.0),
    lag_s=0.01,
    encoder_mm=0.005,
    encoder_rad=2e-5,
)
TUMOR_MOTION = TumorMotionParameters(
    swing_mm=5.0,
    swing_rad=math.radians(2.0),
    rate_hz=0.25,
    jitter_mm=0.3,
    jitter_rad=math.radians(0.3),
)

_TRACKED_NS = NS_PER_S
"""Duration of tracking before the push."""

_IDLE_S = 0.02
"""Time before the hand pushes, in which the monitor receives its first samples."""

_START_MM = 30.0
_MAX_TILT = math.radians(60.0)
_BREATH_AXIS = np.array([0.2, 0.3, 0.933])
_CENTER_MM = np.array([400.0, -30.0, 150.0])
_BASE_FROM_TRACKER = Transform.from_rotation_vector(
    [0.4, -0.3, 1.1], [250.0, 120.0, 90.0], target="robot_base", source="tracker"
)


@dataclass(frozen=True, slots=True)
class Tracker:
    """Sampling rate, delay and noise per axis of the tracker."""

    rate_hz: float = 50.0
    delay_ns: int = 20 * NS_PER_MS
    jitter_mm: float = 0.3
    jitter_rad: float = math.radians(0.3)


@dataclass(frozen=True, slots=True)
class Push:
    """Parameters of one push.

    ``seed`` determines all random values. ``fixture``: whether the fixture is on. ``swing_mm``:
    amplitude of the tumour's motion. ``push_s`` and ``pull_s``: duration of the push and of the
    pull. ``turn_s``: the hand also rotates the tool for this time. ``settled_s``: duration at the
    end of the push that is evaluated for a limit cycle. ``registration_mm``: standard deviation per
    axis of the tracker's registration to the robot, which the fixture knows, unlike its error.
    ``recent``: whether recent witnesses are used.
    """

    seed: int
    fixture: bool
    swing_mm: float
    push_s: float
    tracker: Tracker = Tracker()
    breath_hz: float = 0.25
    force_n: float = 10.0
    torque_nm: float = 0.1
    turn_s: float = 0.4
    pull_s: float = 0.15
    settled_s: float = 0.25
    registration_mm: float = 0.0
    recent: bool = True


@dataclass(slots=True)
class PushResult:
    """The results of one push; lists have an entry every `TRUTH_EVERY` steps.

    ``distance_mm``: the true signed distance. ``state`` and ``stop_mm``: the fixture's margin state
    and applied stop margin. ``settled_mm``: distances at the end of the push. ``lowest``:
    ``tumor_from_tool`` at the lowest distance. ``retreats``: number of steps in which the hand
    approached no plane. ``slowed_mm_s``: maximum reduction of the retreat speed in these steps, at
    any witness. ``pull_lag_mm``: maximum lag behind a free twin of the tool while the hand pulls
    both out; above 0 if the pull brings another part of the tool nearer.
    """

    seconds: list[float] = field(default_factory=list)
    distance_mm: list[float] = field(default_factory=list)
    state: list[MarginState] = field(default_factory=list)
    stop_mm: list[float] = field(default_factory=list)
    settled_mm: list[float] = field(default_factory=list)
    lowest: Transform | None = None
    top_speed_mm_s: float = 0.0
    retreats: int = 0
    slowed_mm_s: float = 0.0
    pull_lag_mm: float = 0.0


class World:
    """A breathing tumour, a tracker, and a hand that pushes in a random direction."""

    def __init__(self, push: Push) -> None:
        rng = np.random.default_rng(push.seed)
        self._push, self._rng, self._samples = push, rng, 0
        self._swing = push.swing_mm * _unit(_BREATH_AXIS)
        self._phase = rng.uniform(0.0, 2.0 * math.pi)
        self._rest = Rotation.random(random_state=rng).as_matrix()
        self.direction = _unit(rng.normal(size=3))
        across = _unit(np.cross(self.direction, rng.normal(size=3)))
        shaft = Rotation.from_rotvec(rng.uniform(0.0, _MAX_TILT) * across).apply(self.direction)
        spin = Rotation.from_rotvec(rng.uniform(0.0, 2.0 * math.pi) * shaft)
        # The shaft of the tool is its -z axis.
        upright = Rotation.align_vectors(shaft[None], np.array([[0.0, 0.0, -1.0]]))[0]
        self.tool_at_start = Transform(
            "robot_base",
            "tool",
            (spin * upright).as_matrix(),
            _CENTER_MM + _START_MM * self.direction,
        )
        self._torque_nm = push.torque_nm * _unit(rng.normal(size=3))
        error_mm = push.registration_mm * rng.normal(size=3)
        self._registration = Transform(
            "robot_base",
            "tracker",
            _BASE_FROM_TRACKER.rotation,
            _BASE_FROM_TRACKER.translation_mm + error_mm,
        )

    def base_from_tumor(self, ns: int) -> Transform:
        """The true pose of the tumour."""
        breath = math.sin(2.0 * math.pi * self._push.breath_hz * ns / NS_PER_S + self._phase)
        return Transform("robot_base", "tumor", self._rest, _CENTER_MM + breath * self._swing)

    def received(self, ns: int) -> list[tuple[Transform, Stamp]]:
        """The samples received since the last call, in the frame of the robot's base."""
        tracker = self._push.tracker
        new: list[tuple[Transform, Stamp]] = []
        while True:
            acquired_ns = round(self._samples * NS_PER_S / tracker.rate_hz)
            if acquired_ns + tracker.delay_ns > ns:
                return new
            new.append((self._registration @ self._measured(acquired_ns), Stamp(acquired_ns)))
            self._samples += 1

    def wrench(self, base_from_tool: Transform, second: float) -> FloatArray:
        """The hand's wrench (6,): towards the tumour's rest position, later outward."""
        if second < _IDLE_S:
            return np.zeros(6)
        force_n, still = self._push.force_n, np.zeros(3)
        if second >= _IDLE_S + self._push.push_s:
            return np.concatenate([force_n * self.direction, still])
        to_go = _CENTER_MM - base_from_tool.translation_mm
        force = force_n * to_go / max(float(np.linalg.norm(to_go)), 3.0)
        turning = second < _IDLE_S + self._push.turn_s
        return np.concatenate([force, self._torque_nm if turning else still])

    def _measured(self, ns: int) -> Transform:
        true = _BASE_FROM_TRACKER.inverse() @ self.base_from_tumor(ns)
        tracker = self._push.tracker
        noise_rotation = Rotation.from_rotvec(
            tracker.jitter_rad * self._rng.normal(size=3)
        ).as_matrix()
        noise_mm = tracker.jitter_mm * self._rng.normal(size=3)
        return Transform(
            "tracker", "tumor", noise_rotation @ true.rotation, true.translation_mm + noise_mm
        )


class Fixture:
    """The virtual fixture: limits a desired twist (6,) along the base's axes."""

    def __init__(self, engine: ProximityEngine, push: Push) -> None:
        self._engine, self._sigma_mm = engine, push.registration_mm
        self._motion = TumorMotionFilter(TUMOR_MOTION)
        self._recent = RecentWitnesses() if push.recent else None
        self._monitor = MarginMonitor(MARGINS)

    def add_samples(self, samples: list[tuple[Transform, Stamp]]) -> None:
        """Update the tumour's motion with the samples of the tracker."""
        for pose, stamp in samples:
            self._motion.update(pose, stamp)

    def decide(
        self, base_from_tool: Transform, now: Stamp
    ) -> tuple[FixtureDecision, Transform, Transform]:
        """The decision, ``base_from_tumor`` and ``tumor_from_tool`` at ``now``."""
        motion = self._motion.at(now)
        if motion is None:
            raise RuntimeError("tracker: has no sample of the tumour; expected at least one")
        tumor_from_tool = motion.base_from_tumor.inverse() @ base_from_tool
        proximity = self._engine.evaluate(tumor_from_tool, motion.stamp)
        if self._recent is not None:
            proximity = self._recent.augment(proximity, tumor_from_tool)
        sigma_mm = math.hypot(self._sigma_mm, motion.sigma_at(proximity.on_tumor_mm))
        decision = self._monitor.update(
            MarginObservation(
                now=now,
                stamp=motion.stamp,
                proximity=proximity,
                problems=frozenset(),
                sigma_tre_mm=sigma_mm,
                # The noise of a tracker never repeats itself.
                unchanged_ns=0,
                tumor_twist=motion.twist,
            )
        )
        return decision, motion.base_from_tumor, tumor_from_tool

    def allow(
        self, desired: FloatArray, base_from_tool: Transform, now: Stamp
    ) -> tuple[FloatArray, FixtureDecision, float | None]:
        """The allowed twist, the decision, and the reduction of a retreat (None if none)."""
        decision, base_from_tumor, tumor_from_tool = self.decide(base_from_tool, now)
        if decision.constraint is None:
            return np.zeros(6), decision, None
        # The constraint is in the tumour's frame.
        to_base = base_from_tumor.rotation
        in_tumor, origin = _rotated(to_base.T, desired), tumor_from_tool.translation_mm
        allowed = limit_twist(in_tumor, decision.constraint, origin, LIMITER)
        slowed = slowed_mm_s(in_tumor, allowed, decision.constraint, origin)
        return _rotated(to_base, allowed), decision, slowed


def slowed_mm_s(
    desired: FloatArray, allowed: FloatArray, constraint: Constraint, origin_mm: FloatArray
) -> float | None:
    """Maximum reduction of the speed of retreat from a plane; None if the twist approaches one."""
    levers = constraint.points_on_tool_mm - origin_mm
    # n . (v + w x r - v_tumor), with n . (w x r) = w . (r x n)
    rows = np.hstack([constraint.normals, np.cross(levers, constraint.normals)])
    tumor_speed = np.einsum("ij,ij->i", constraint.normals, constraint.tumor_velocities_mm_s)
    retreat_speed = rows @ desired - tumor_speed
    if (retreat_speed < 0.0).any():
        return None
    return max(0.0, float((rows @ (desired - allowed)).max()))


def simulate(push: Push, engine: ProximityEngine, truth: ProximityEngine) -> PushResult:
    """Simulate a push and a pull; ``truth`` is a separate engine for the true distance."""
    world, fixture = World(push), Fixture(engine, push)
    fixture.add_samples(world.received(_TRACKED_NS))
    tool, twin = AdmittanceTool(world.tool_at_start, HAND), None
    found, lowest_mm = PushResult(), math.inf
    pull_from_s = _IDLE_S + push.push_s
    for step in range(round((pull_from_s + push.pull_s) * NS_PER_S / STEP_NS)):
        ns, second = _TRACKED_NS + step * STEP_NS, step * STEP_NS / NS_PER_S
        is_measured = step % TRUTH_EVERY == 0
        if is_measured:
            pose = world.base_from_tumor(ns).inverse() @ tool.base_from_tool
            distance_mm = truth.evaluate(pose).signed_distance_mm
            found.seconds.append(second)
            found.distance_mm.append(distance_mm)
            if distance_mm < lowest_mm:
                lowest_mm, found.lowest = distance_mm, pose
            if pull_from_s - push.settled_s <= second < pull_from_s:
                found.settled_mm.append(distance_mm)
        command = tool.desired_twist(world.wrench(tool.base_from_tool, second))
        if push.fixture:
            fixture.add_samples(world.received(ns))
            command, decision, slowed = fixture.allow(command, tool.encoder_pose, Stamp(ns))
            if slowed is not None and second >= _IDLE_S:
                found.retreats += 1
                found.slowed_mm_s = max(found.slowed_mm_s, slowed)
            if is_measured and decision.margin is not None:
                found.state.append(decision.state)
                found.stop_mm.append(decision.margin.total_mm)
        if second >= pull_from_s:
            twin = twin or AdmittanceTool(tool.base_from_tool, HAND, tool.twist)
            twin.follow(twin.desired_twist(world.wrench(twin.base_from_tool, second)), STEP_NS)
        tool.follow(command, STEP_NS)
        if twin is not None:
            ahead = twin.base_from_tool.translation_mm - tool.base_from_tool.translation_mm
            found.pull_lag_mm = max(found.pull_lag_mm, float(ahead @ world.direction))
        found.top_speed_mm_s = max(found.top_speed_mm_s, float(np.linalg.norm(tool.twist[:3])))
    return found


def _rotated(rotation: FloatArray, twist: FloatArray) -> FloatArray:
    return np.concatenate([rotation @ twist[:3], rotation @ twist[3:]])


def _unit(vector: FloatArray) -> FloatArray:
    return np.asarray(vector / np.linalg.norm(vector))
