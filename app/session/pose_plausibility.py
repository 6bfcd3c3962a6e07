"""All checks of a session that find a wrong pose by its motion or by another measurement.

Pure: reads no clock. A pose that moves as its sensor cannot is not used, and measurements that
contradict each other are a fault of the margin.
"""

from collections.abc import Mapping
from collections.abc import Set as AbstractSet
from dataclasses import replace
from types import MappingProxyType

from app.case import JointSample, PlausibilityEntry, TrackingFrame
from app.fixture import Reason
from app.geometry import Edge, Stamp, TrackedTransform, Transform, shortest_path
from app.registration import RegistrationDrift
from app.session.joint_check import JointCheck
from app.session.pose_tree import PoseTree, is_too_far
from app.session.relations import Problems, Relations
from app.session.sensor_motion import MotionLimits, SensorMotion
from app.session.setup import REFERENCE, SessionSetup


class MotionCheck:
    """One `SensorMotion` per measured edge. Samples of other edges pass unchecked."""

    def __init__(self, limits: MotionLimits) -> None:
        self._limits = limits
        self._sensors: dict[Edge, SensorMotion] = {}
        self._newest_ns: dict[Edge, int] = {}
        self._now: Stamp | None = None
        # Run the kernel once, so that the first step does not wait for the compiler.
        SensorMotion(limits).update(Transform.identity("tracker", "sensor"), 0)

    def use(self, limits: MotionLimits) -> None:
        """Replace the limits; what is known of the sensors is kept."""
        self._limits = limits
        for sensor in self._sensors.values():
            sensor.use(limits)

    def remove_implausible(self, frame: TrackingFrame, edges: AbstractSet[Edge]) -> TrackingFrame:
        """``frame`` without the samples of ``edges`` that must not be used."""
        if self._now is not None and frame.stamp < self._now:
            self._newest_ns.clear()
            for sensor in self._sensors.values():
                sensor.restart()
        self._now = frame.stamp
        refused = [
            sample
            for sample in frame.poses
            if (sample.target, sample.source) in edges and not self._is_usable(sample, frame.stamp)
        ]
        if not refused:
            return frame
        return replace(
            frame, poses=tuple(sample for sample in frame.poses if sample not in refused)
        )

    def refused(self, edges: AbstractSet[Edge]) -> dict[str, str]:
        """The sensors of ``edges`` that are not believed now: one line each, by name."""
        found = {}
        for edge, sensor in self._sensors.items():
            if not sensor.believed and edge in edges and (jump := sensor.jump) is not None:
                name = f"{edge[0]} -> {edge[1]}"
                found[name] = f"{name} {jump.text}"
        return found

    def _is_usable(self, sample: TrackedTransform, now: Stamp) -> bool:
        edge = (sample.target, sample.source)
        ns, newest_ns = sample.stamp.ns, self._newest_ns.get(edge)
        # As in `PoseTree`: a sample that comes late is not used, and one from the future is now.
        if newest_ns is not None and ns < newest_ns <= now.ns:
            return True
        self._newest_ns[edge] = ns
        pose = sample.transform
        # Drivers send large numbers for a missing pose.
        if pose is None or is_too_far(pose.translation_mm.tolist()):
            return True
        sensor = self._sensors.get(edge)
        if sensor is None:
            sensor = self._sensors[edge] = SensorMotion(self._limits)
        return sensor.update(pose, ns if ns < now.ns else now.ns)


SINGLE_SOURCE = "one source: nothing checks the tracker"
"""Text of `StepResult.single_source` for people."""

_BEGINNINGS = {
    Reason.IMPLAUSIBLE: "implausible pose",
    Reason.REGISTRATION_DRIFT: "drift",
    Reason.CONTRADICTION: "contradiction",
    Reason.REDUNDANCY_LOST: "nothing checks the tracker",
}

_NO_FAULTS: Mapping[Reason, str] = MappingProxyType({})


class Plausibility:
    """Motion of the sensors, joints against tracker, and the configured relations.

    Once per step: `remove_implausible` for the frame, then `drift` and `faults`.
    """

    def __init__(self, setup: SessionSetup) -> None:
        self._motion = MotionCheck(_limits(setup.plausibility))
        self._found: dict[Reason, Problems] = {reason: {} for reason in _BEGINNINGS}
        self._has_found = False
        """True if the last `faults` were any."""
        self._edges: tuple[Edge, ...] = ()
        self._used: frozenset[Edge] = frozenset()
        self._relations = Relations(setup.plausibility, setup.tool_from_tip)
        self._joints = _joints(setup)
        self._set_up(setup)

    def use(self, setup: SessionSetup, before: SessionSetup) -> None:
        """Replace the setup ``before``; what is known of the sensors' motion is kept."""
        changed = setup.plausibility is not before.plausibility
        self._motion.use(_limits(setup.plausibility))
        if changed:
            self._relations = Relations(setup.plausibility, setup.tool_from_tip)
        elif setup.tool_from_tip is not before.tool_from_tip:
            self._relations.use_tip(setup.tool_from_tip)
        if changed or setup.robot is not before.robot:
            self._joints = _joints(setup)
        self._set_up(setup)

    def remove_implausible(self, frame: TrackingFrame, poses: PoseTree) -> TrackingFrame:
        """``frame`` without samples that their sensors cannot have measured."""
        edges = poses.edges
        if edges != self._edges:
            self._edges = edges
            paths = [shortest_path(edges, *ends) or () for ends in self._ends]
            self._used = frozenset(edge for path in paths for edge in path)
        return self._motion.remove_implausible(frame, self._used)

    def drift(
        self,
        links: Mapping[str, Transform],
        joints: JointSample | None,
        reference_from_tip: Transform | None,
        now: Stamp,
    ) -> RegistrationDrift | None:
        """Difference between the tracked tool and the tool by joints; None if one is not known."""
        return self._joints.update(links, joints, reference_from_tip, now)

    def faults(self, poses: PoseTree, now: Stamp) -> Mapping[Reason, str]:
        """The faults of this step, each with one line that names values and limits.

        A text stays the same until another relation fails or one holds again.
        """
        failed: Problems = {}
        silent: Problems = {"joints": "no joint positions"} if self._joints.is_silent else {}
        if self._relations:
            failed, unknown = self._relations.check(lambda *ends: self._pose(poses, *ends), now)
            silent |= unknown
        refused, drifts = self._motion.refused(self._used), self._joints.drifts()
        if not (refused or drifts or failed or silent or self._has_found):
            return _NO_FAULTS
        found = {
            Reason.IMPLAUSIBLE: refused,
            Reason.REGISTRATION_DRIFT: drifts,
            Reason.CONTRADICTION: failed,
            Reason.REDUNDANCY_LOST: silent,
        }
        self._has_found = any(found.values())
        for reason, problems in found.items():
            if problems.keys() != self._found[reason].keys():
                self._found[reason] = problems
        return {
            reason: f"{_BEGINNINGS[reason]}: {'; '.join(problems.values())}"
            for reason, problems in self._found.items()
            if problems
        }

    def _pose(self, poses: PoseTree, target: str, source: str) -> Transform | None:
        if target != self._base:
            return poses.pose(target, source).transform
        pose = poses.pose(REFERENCE, source).transform
        if pose is None or self._base_from_reference is None:
            return None
        return self._base_from_reference @ pose

    def _set_up(self, setup: SessionSetup) -> None:
        robot = setup.robot
        self._base = None if robot is None else robot.base_frame
        self._base_from_reference = (
            None
            if robot is None or robot.registration is None
            else robot.registration.transform.inverse()
        )
        self._ends = setup.measured_ends
        self._edges = ()
        self.single_source = not (self._relations or self._joints.is_configured)
        """True if nothing independent can contradict the tracker."""


def _joints(setup: SessionSetup) -> JointCheck:
    return JointCheck(setup.robot, setup.plausibility.mean_drift_mm)


def _limits(entry: PlausibilityEntry) -> MotionLimits:
    motion = entry.motion
    if motion is None:
        return MotionLimits()
    return MotionLimits(
        motion.speed_mm_s,
        motion.acceleration_mm_s2,
        motion.speed_rad_s,
        motion.acceleration_rad_s2,
    )
