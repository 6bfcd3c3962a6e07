"""Test doubles and samples for the fixture and the session."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from app.case import JointSample, TrackingFrame
from app.fixture import (
    Constraint,
    FixtureDecision,
    MarginMonitor,
    MarginObservation,
    MarginParameters,
    MarginState,
    PlainConstraint,
    Proximity,
    Reason,
    SweptProximity,
    Witnesses,
)
from app.geometry import NS_PER_MS, FloatArray, Stamp, TrackedTransform, TrackingStatus, Transform
from app.hold import Hold

PARAMETERS = MarginParameters(
    stop_mm=1.0,
    warn_mm=5.0,
    k_tre=2.0,
    v_max_mm_s=50.0,
    stale_after_ns=200 * NS_PER_MS,
    release_samples=3,
    release_band_mm=0.5,
    frozen_after_ns=1000 * NS_PER_MS,
)
STEP_NS = 20 * NS_PER_MS


def near(
    distance_mm: float,
    *,
    slack_mm: float = 0.005,
    contact: bool = False,
    stamp: Stamp | None = None,
) -> Proximity:
    """Proximity of a tool ``distance_mm`` above a tumour whose top is at z = 10 mm."""
    witness = Witnesses.single(
        distance_mm,
        np.array([0.0, 0.0, 10.0 + distance_mm]),
        np.array([0.0, 0.0, 10.0]),
        np.array([0.0, 0.0, 1.0]),
    )
    return Proximity(distance_mm - slack_mm, witness, stamp, contact)


class HeldMonitor(MarginMonitor):
    """A monitor with the hold that follows it, joined as `Session` joins them."""

    def __init__(self, parameters: MarginParameters, *, frame: str = "tumor") -> None:
        super().__init__(parameters, frame=frame)
        self._hold = Hold()

    @property
    def latched(self) -> bool:
        return self._hold.latched

    def update(self, observation: MarginObservation) -> FixtureDecision:
        return self._hold.applied(super().update(observation), {})

    def rearm(self) -> None:
        self._hold.rearm()

    def hold(self) -> None:
        self._hold.latch("held by a test")

    def restart(self) -> None:
        super().restart()
        self._hold.restart()


@dataclass
class Runner:
    """Feeds a monitor with one observation per step, 20 ms apart by default."""

    monitor: HeldMonitor = field(default_factory=lambda: HeldMonitor(PARAMETERS))
    now_ns: int = 1_000_000_000

    def observation(
        self,
        proximity: Proximity | float | None,
        *problems: Reason,
        age_ns: int = 0,
        sigma_mm: float = 0.0,
        unchanged_ns: int = 0,
        advance_ns: int = STEP_NS,
        stamp: bool = True,
        tumor_twist: FloatArray | None = None,
    ) -> MarginObservation:
        self.now_ns += advance_ns
        return MarginObservation(
            now=Stamp(self.now_ns),
            stamp=Stamp(self.now_ns - age_ns) if stamp else None,
            proximity=near(proximity) if isinstance(proximity, float) else proximity,
            problems=frozenset(problems),
            sigma_tre_mm=sigma_mm,
            unchanged_ns=unchanged_ns,
            tumor_twist=tumor_twist,
        )

    def step(
        self, proximity: Proximity | float | None, *problems: Reason, **rest: object
    ) -> FixtureDecision:
        return self.monitor.update(self.observation(proximity, *problems, **rest))  # type: ignore[arg-type]


class AnalyticSphere:
    """Test double of a proximity engine: exact distance of the tip to a sphere at the origin."""

    radius_mm = 0.0
    frames = ("tumor", None)

    def __init__(self, sphere_mm: float) -> None:
        self.sphere_mm = sphere_mm

    def evaluate(self, tumor_from_tool: Transform, stamp: Stamp | None = None) -> Proximity:
        tip = tumor_from_tool.translation_mm
        normal = tip / np.linalg.norm(tip)
        distance = float(np.linalg.norm(tip)) - self.sphere_mm
        witnesses = Witnesses.single(distance, tip, self.sphere_mm * normal, normal)
        return Proximity(distance, witnesses, stamp)

    def sweep(
        self, previous: Transform, current: Transform, stamp: Stamp | None = None
    ) -> SweptProximity:
        poses = [
            self.evaluate(previous.interpolate(current, part), stamp)
            for part in np.linspace(0.0, 1.0, 101)
        ]
        closest = min(poses, key=lambda proximity: proximity.signed_distance_mm)
        return SweptProximity(closest, 0.01 * poses.index(closest), closest.signed_distance_mm)


def sample(
    target: str, source: str, position_mm: tuple[float, float, float], at_ms: float
) -> TrackedTransform:
    pose = Transform(target, source, np.eye(3), position_mm)
    return TrackedTransform(pose, Stamp(int(at_ms * NS_PER_MS)), TrackingStatus.OK)


def lost(target: str, source: str, at_ms: float, status: TrackingStatus) -> TrackedTransform:
    return TrackedTransform.lost(target, source, Stamp(int(at_ms * NS_PER_MS)), status)


def frame(at_ms: float, *poses: TrackedTransform, joints: tuple[JointSample, ...] = ()):
    return TrackingFrame(Stamp(int(at_ms * NS_PER_MS)), poses, joints)


def joint_sample(positions: Mapping[str, float], at_ms: float) -> JointSample:
    return JointSample(
        tuple(positions), np.array(list(positions.values())), Stamp(int(at_ms * NS_PER_MS))
    )


def simulated_message(
    planes: Constraint, state: MarginState, seq: int, stamp_ns: int, valid_ns: int
) -> PlainConstraint:
    """The message that a controller receives from a guard whose poses are simulated."""
    return PlainConstraint(
        instance_id="guard",
        seq=seq,
        frame=planes.frame,
        stamp_ns=stamp_ns,
        valid_until_ns=stamp_ns + valid_ns,
        state=int(state),
        hold=planes.hold,
        simulated=True,
        planes_current=True,
        normals=planes.normals,
        offsets_mm=planes.offsets_mm,
        points_on_tool_mm=planes.points_on_tool_mm,
        tumor_velocities_mm_s=planes.tumor_velocities_mm_s,
        free_distance_mm=planes.free.distance_mm,
        free_turn_rad=planes.free.turn_rad,
        max_tool_speed_mm_s=250.0,
        max_tool_turn_rad_s=2.0,
        setup_id="setup",
    )
