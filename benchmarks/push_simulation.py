"""A hand pushes a robot-held tool at a tumour: what the fixture knows, and what is true.

The fixture's way is the product's own, at 1 kHz: `TumorMotionFilter`, `ProximityEngine`,
`RecentWitnesses`, `MarginMonitor`, `limit_twist`. It knows the tool by the robot's encoders, and
the tumour by a tracker that is late, rare and shaky. The truth is measured beside it.
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
"""Steps between two measurements of the truth: near the stop the tool goes little in 5 ms."""

MARGINS = MarginParameters(
    stop_mm=1.0,
    warn_mm=5.0,
    k_tre=3.0,
    # The tool is known by its encoders: what moves unseen is the tumour, and so fast at most.
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

_WATCHED_NS = NS_PER_S
"""The tracker has been watching for so long when the tool comes."""

_IDLE_S = 0.02
"""Before the hand pushes; the monitor takes a few samples to trust its inputs."""

_START_MM = 30.0
_MOST_TILT = math.radians(60.0)
_BREATH_AXIS = np.array([0.2, 0.3, 0.933])
_CENTER_MM = np.array([400.0, -30.0, 150.0])
_BASE_FROM_TRACKER = Transform.from_rotation_vector(
    [0.4, -0.3, 1.1], [250.0, 120.0, 90.0], target="robot_base", source="tracker"
)


@dataclass(frozen=True, slots=True)
class Tracker:
    """How the tumour is seen: samples a second, how late they come, and their noise an axis."""

    rate_hz: float = 50.0
    delay_ns: int = 20 * NS_PER_MS
    jitter_mm: float = 0.3
    jitter_rad: float = math.radians(0.3)


@dataclass(frozen=True, slots=True)
class Push:
    """One push: with the fixture or without, for how long, and what the tumour does meanwhile.

    ``seed`` chooses everything that is left to chance. ``swing_mm`` is an amplitude: the tumour
    goes so far to both sides of its place of rest. ``turn_s``: the hand also turns the tool until
    then. ``settled_s``: the end of the push, in which it is looked for a limit cycle.
    ``registration_mm``: standard deviation an axis of the tracker's registration to the robot; the
    fixture knows this figure, and not the error.
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
class Pushed:
    """What one push did; lists have an entry every `TRUTH_EVERY` steps.

    ``distance_mm``: the true signed distance. ``state`` and ``stop_mm``: what the fixture made of
    it, and the stop margin it applied. ``settled_mm``: distances at the end of the push.
    ``lowest``: ``tumor_from_tool`` at the lowest of them. ``retreats``: steps in which the hand
    wanted to approach nowhere; ``slowed_mm_s``: how much slower such a step was made, at any
    witness. ``pull_lag_mm``: how far the tool was behind its twin without a fixture while the hand
    pulled both out; more than nothing where the pull brought another part of the tool nearer.
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
    """A tumour that breathes, a tracker that sees it, and a hand with a direction of its own."""

    def __init__(self, push: Push) -> None:
        rng = np.random.default_rng(push.seed)
        self._push, self._rng, self._samples = push, rng, 0
        self._swing = push.swing_mm * _unit(_BREATH_AXIS)
        self._phase = rng.uniform(0.0, 2.0 * math.pi)
        self._rest = Rotation.random(random_state=rng).as_matrix()
        self.direction = _unit(rng.normal(size=3))
        across = _unit(np.cross(self.direction, rng.normal(size=3)))
        shaft = Rotation.from_rotvec(rng.uniform(0.0, _MOST_TILT) * across).apply(self.direction)
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
        """Where the tumour truly is."""
        breath = math.sin(2.0 * math.pi * self._push.breath_hz * ns / NS_PER_S + self._phase)
        return Transform("robot_base", "tumor", self._rest, _CENTER_MM + breath * self._swing)

    def arrived(self, ns: int) -> list[tuple[Transform, Stamp]]:
        """The samples that have come in since the last call, as the robot understands them."""
        tracker = self._push.tracker
        new: list[tuple[Transform, Stamp]] = []
        while True:
            acquired_ns = round(self._samples * NS_PER_S / tracker.rate_hz)
            if acquired_ns + tracker.delay_ns > ns:
                return new
            new.append((self._registration @ self._seen(acquired_ns), Stamp(acquired_ns)))
            self._samples += 1

    def wrench(self, base_from_tool: Transform, second: float) -> FloatArray:
        """Of the hand, (6,): to where the tumour rests, where it lets go; later out again."""
        if second < _IDLE_S:
            return np.zeros(6)
        force_n, still = self._push.force_n, np.zeros(3)
        if second >= _IDLE_S + self._push.push_s:
            return np.concatenate([force_n * self.direction, still])
        to_go = _CENTER_MM - base_from_tool.translation_mm
        force = force_n * to_go / max(float(np.linalg.norm(to_go)), 3.0)
        turning = second < _IDLE_S + self._push.turn_s
        return np.concatenate([force, self._torque_nm if turning else still])

    def _seen(self, ns: int) -> Transform:
        true = _BASE_FROM_TRACKER.inverse() @ self.base_from_tumor(ns)
        tracker = self._push.tracker
        shake = Rotation.from_rotvec(tracker.jitter_rad * self._rng.normal(size=3)).as_matrix()
        shift_mm = tracker.jitter_mm * self._rng.normal(size=3)
        return Transform("tracker", "tumor", shake @ true.rotation, true.translation_mm + shift_mm)


class Fixture:
    """A wanted twist in, an allowed one out, both (6,) along the base's axes."""

    def __init__(self, engine: ProximityEngine, push: Push) -> None:
        self._engine, self._sigma_mm = engine, push.registration_mm
        self._motion = TumorMotionFilter(TUMOR_MOTION)
        self._recent = RecentWitnesses() if push.recent else None
        self._monitor = MarginMonitor(MARGINS)

    def see(self, samples: list[tuple[Transform, Stamp]]) -> None:
        """Take in what the tracker has sent."""
        for pose, stamp in samples:
            self._motion.update(pose, stamp)

    def allow(
        self, wanted: FloatArray, base_from_tool: Transform, now: Stamp
    ) -> tuple[FloatArray, FixtureDecision, float | None]:
        """The allowed twist, why, and by how much a retreat was slowed (None when it is none)."""
        motion = self._motion.at(now)
        if motion is None:
            raise RuntimeError("the tracker has not seen the tumour yet")
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
        if decision.constraint is None:
            return np.zeros(6), decision, None
        # The constraint speaks of the tumour's frame: the twist is turned there and back.
        to_base = motion.base_from_tumor.rotation
        in_tumor, origin = _turned(to_base.T, wanted), tumor_from_tool.translation_mm
        allowed = limit_twist(in_tumor, decision.constraint, origin, LIMITER)
        slower = slowed_mm_s(in_tumor, allowed, decision.constraint, origin)
        return _turned(to_base, allowed), decision, slower


def slowed_mm_s(
    wanted: FloatArray, allowed: FloatArray, constraint: Constraint, origin_mm: FloatArray
) -> float | None:
    """By how much a twist (6,) leaves a plane slower than wanted; None if it approaches one."""
    levers = constraint.points_on_tool_mm - origin_mm
    # n . (v + w x r - v_tumor), with n . (w x r) = w . (r x n)
    rows = np.hstack([constraint.normals, np.cross(levers, constraint.normals)])
    coming = np.einsum("ij,ij->i", constraint.normals, constraint.tumor_velocities_mm_s)
    leaving = rows @ wanted - coming
    if (leaving < 0.0).any():
        return None
    return max(0.0, float((rows @ (wanted - allowed)).max()))


def simulate(push: Push, engine: ProximityEngine, truth: ProximityEngine) -> Pushed:
    """Push and hold, then pull out. ``truth`` measures, and is an engine of its own."""
    world, fixture = World(push), Fixture(engine, push)
    fixture.see(world.arrived(_WATCHED_NS))
    tool, twin = AdmittanceTool(world.tool_at_start, HAND), None
    found, lowest_mm = Pushed(), math.inf
    pull_from_s = _IDLE_S + push.push_s
    for step in range(round((pull_from_s + push.pull_s) * NS_PER_S / STEP_NS)):
        ns, second = _WATCHED_NS + step * STEP_NS, step * STEP_NS / NS_PER_S
        looked = step % TRUTH_EVERY == 0
        if looked:
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
            fixture.see(world.arrived(ns))
            command, decision, slower = fixture.allow(command, tool.encoder_pose, Stamp(ns))
            if slower is not None and second >= _IDLE_S:
                found.retreats += 1
                found.slowed_mm_s = max(found.slowed_mm_s, slower)
            if looked and decision.margin is not None:
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


def _turned(rotation: FloatArray, twist: FloatArray) -> FloatArray:
    return np.concatenate([rotation @ twist[:3], rotation @ twist[3:]])


def _unit(vector: FloatArray) -> FloatArray:
    return np.asarray(vector / np.linalg.norm(vector))
