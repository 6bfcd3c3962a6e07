"""All checks of a session that find a wrong pose by its motion or by another measurement.

Pure: reads no clock. A pose that moves as its sensor cannot is not used, and measurements that
contradict each other are a fault of the margin.
"""

from collections.abc import Mapping
from types import MappingProxyType

from app.case import JointSample, PlausibilityEntry
from app.fixture import Reason
from app.geometry import Stamp, Transform
from app.registration import RegistrationDrift
from app.session.joint_check import JointCheck
from app.session.pose_tree import PoseTree
from app.session.relations import Problems, Relations
from app.session.sensor_motion import MotionLimits
from app.session.setup import REFERENCE, SessionSetup

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

    Once per step: `drift`, then `faults`.
    """

    def __init__(self, setup: SessionSetup) -> None:
        self._found: dict[Reason, Problems] = {reason: {} for reason in _BEGINNINGS}
        self._has_found = False
        """True if the last `faults` were any."""
        self._relations = Relations(setup.plausibility, setup.tool_from_tip)
        self._joints = _joints(setup)
        self._set_up(setup)

    def use(self, setup: SessionSetup, before: SessionSetup) -> None:
        """Replace the setup ``before``."""
        changed = setup.plausibility is not before.plausibility
        if changed:
            self._relations = Relations(setup.plausibility, setup.tool_from_tip)
        elif setup.tool_from_tip is not before.tool_from_tip:
            self._relations.use_tip(setup.tool_from_tip)
        if changed or setup.robot is not before.robot:
            self._joints = _joints(setup)
        self._set_up(setup)

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
        refused, drifts = poses.implausible(), self._joints.drifts()
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
        self.single_source = not (self._relations or self._joints.is_configured)
        """True if nothing independent can contradict the tracker."""


def _joints(setup: SessionSetup) -> JointCheck:
    return JointCheck(setup.robot, setup.plausibility.mean_drift_mm)


def motion_limits(entry: PlausibilityEntry) -> MotionLimits:
    """Limits of the motion of each sensor."""
    motion = entry.motion
    if motion is None:
        return MotionLimits()
    return MotionLimits(
        motion.speed_mm_s,
        motion.acceleration_mm_s2,
        motion.speed_rad_s,
        motion.acceleration_rad_s2,
    )
