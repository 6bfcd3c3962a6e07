"""The cooperative controller between a hand and an arm.

At each step the hand's wrench gives a desired twist (admittance), and one quadratic program the
joint velocities nearest to it within the planes of the constraint, the joint limits and speeds,
damped near singularities. Whatever is missing, late or not finite means no motion.
"""

import math
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cache

import numpy as np

from app.control.compliance import AdmittanceGains, HandAdmittance
from app.fixture import FixtureRule, JointLimits, PlainConstraint, RulePermission, RuleReason
from app.geometry import (
    NS_PER_MS,
    FloatArray,
    FrameError,
    Freshness,
    FreshnessLimits,
    InputError,
    MarginGuardError,
    Transform,
    freshness_of,
)
from app.robot import Robot


@dataclass(frozen=True, slots=True, eq=False)
class JointMeasurement:
    """Positions of joints by name, in rad, m for sliding joints (CRTK's ``measured_js``)."""

    stamp_ns: int
    names: tuple[str, ...]
    positions: tuple[float, ...]


@dataclass(frozen=True, slots=True, eq=False)
class WrenchMeasurement:
    """The hand's force (3,) in N at the tool's tip and its torque (3,) in N m about the tip.

    In the axes of the tool if ``in_tool`` (CRTK's ``body/measured_cf``), else of the robot's base.
    """

    stamp_ns: int
    force_n: FloatArray
    torque_n_m: FloatArray
    in_tool: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class PoseMeasurement:
    """``rule_from_base``: the robot's base in the frame of the constraint."""

    stamp_ns: int
    rule_from_base: Transform


class ToolKinematics:
    """The tip at ``link_from_tip`` of a link, moved by the joints on the way to that link.

    Raises `FrameError` for a transform of another link.
    """

    def __init__(self, robot: Robot, link_from_tip: Transform) -> None:
        self.robot, self.link_from_tip = robot, link_from_tip
        self._link = link_from_tip.target
        if self._link not in {link.name for link in robot.links}:
            raise FrameError(
                f"the tool is held by {self._link!r}; "
                f"expected one of {', '.join(link.name for link in robot.links)}"
            )
        self.joints = robot.actuated_joint_names
        self.slides = np.array([robot.tree.joint(name).slides for name in self.joints])
        """(n,) true for the joints whose positions are in m."""

    @property
    def base(self) -> str:
        """The robot's base link."""
        return self.robot.root_link

    def evaluate(self, positions: FloatArray) -> tuple[Transform, FloatArray]:
        """``base_from_tip``, and the Jacobian (6, n) of the tip for all actuated joints.

        Rows are the tip's velocity (mm) and angular velocity (rad) in the base's axes, per rad or
        m. Raises `JointError` for positions that are not finite or at which a loop does not close.
        """
        named = dict(zip(self.joints, positions.tolist(), strict=True))
        base_from_link, jacobian = self.robot.jacobian(self._link, named)
        x, y, z = base_from_link.rotate(self.link_from_tip.translation_mm).tolist()
        jacobian[:3] += np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]) @ jacobian[3:]
        return base_from_link @ self.link_from_tip, jacobian

    def limits(self, max_speed: float | None = None) -> JointLimits:
        """Limits of the joints; ``max_speed`` for those that the robot's file gives none.

        Raises `InputError` where neither gives one.
        """
        found = {joint.name: joint for joint in self.robot.joints}
        speeds = []
        for name in self.joints:
            speed = found[name].dynamics.velocity or max_speed
            if speed is None or not (math.isfinite(speed) and speed > 0.0):
                raise InputError(
                    f"joint {name!r} has the speed limit {found[name].dynamics.velocity}; "
                    "expected one above 0 in the robot's file, or a largest joint speed"
                )
            speeds.append(speed)
        return JointLimits(
            np.array([found[name].lower for name in self.joints]),
            np.array([found[name].upper for name in self.joints]),
            np.array(speeds),
        )


class ControlReason(StrEnum):
    """Reason why the arm moves, or stands."""

    FOLLOWS = "follows"
    """The hand moves the arm, within the planes."""
    RULE = "rule"
    """The constraint allows no motion or only retreat: `ControlDecision.rule` has its reason."""
    WATCHDOG = "watchdog"
    """No valid constraint for the time of the watchdog; latched until `rearm`."""
    NO_JOINTS = "no_joints"
    """No joint positions, too old ones, of other joints, or not finite."""
    NO_WRENCH = "no_wrench"
    """No wrench, a too old one, or one that is not finite."""
    NO_POSE = "no_pose"
    """The robot's base is not known in the constraint's frame, or its pose is too old."""


@dataclass(frozen=True, slots=True)
class ControllerParameters:
    """Ages in ns beyond which a measurement is not used, and the admittance.

    ``watchdog_ns``: after so long without a valid constraint the arm stops until `rearm`.
    ``max_joint_speed``: for joints without a speed limit in the robot's file, rad/s or m/s.
    Raises `InputError` for ages that are not above 0.
    """

    gains: AdmittanceGains = field(default_factory=AdmittanceGains)
    max_joints_age_ns: int = 30 * NS_PER_MS
    max_wrench_age_ns: int = 30 * NS_PER_MS
    max_pose_age_ns: int = 100 * NS_PER_MS
    watchdog_ns: int = 30 * NS_PER_MS
    max_joint_speed: float | None = None

    def __post_init__(self) -> None:
        for name in ("max_joints_age_ns", "max_wrench_age_ns", "max_pose_age_ns", "watchdog_ns"):
            if getattr(self, name) <= 0:
                raise InputError(
                    f"{name} of the controller is {getattr(self, name)}; expected more than 0"
                )


@dataclass(frozen=True, slots=True, eq=False)
class ControlDecision:
    """Velocities (n,) of ``joints``, rad/s or m/s, to send now, and why.

    ``desired`` (6,) is the twist that the hand asks for, in mm/s and rad/s in the base's axes.
    ``rule`` is the reason of the fixture's rule, None where it was not asked.
    """

    joints: tuple[str, ...]
    velocities: FloatArray
    reason: ControlReason
    rule: RuleReason | None
    desired: FloatArray


class CooperativeController:
    """Pure: `receive` at each constraint, `step` at each control period. Use in one thread.

    ``rule`` decides about the constraint; poses are in its frame. Raises `InputError` for a joint
    without speed limit.
    """

    def __init__(
        self,
        tool: ToolKinematics,
        rule: FixtureRule,
        parameters: ControllerParameters | None = None,
    ) -> None:
        self.parameters = parameters or ControllerParameters()
        self._tool, self._rule = tool, rule
        self._limits = tool.limits(self.parameters.max_joint_speed)
        self._hand = HandAdmittance(self.parameters.gains)
        self._valid_ns: int | None = None
        self._latched = False

    @property
    def latched(self) -> bool:
        """True if the watchdog has stopped the arm; see `rearm`."""
        return self._latched

    @property
    def constraint(self) -> PlainConstraint | None:
        """The constraint in use; None before the first one."""
        return self._rule.message

    def rearm(self) -> None:
        """Let the arm move again. Call it only on a request of the operator."""
        self._rule.rearm()
        self._hand.reset()
        self._valid_ns, self._latched = None, False

    def receive(self, constraint: PlainConstraint, now_ns: int) -> None:
        """Use ``constraint``, which has just arrived."""
        self._rule.receive(constraint, now_ns)

    def step(
        self,
        joints: JointMeasurement | None,
        wrench: WrenchMeasurement | None,
        pose: PoseMeasurement | None,
        now_ns: int,
    ) -> ControlDecision:
        """The decision at ``now_ns``; without motion for any measurement that is not usable."""
        self._watch(now_ns)
        positions = positions_of(
            joints, self._tool.joints, self.parameters.max_joints_age_ns, now_ns
        )
        if positions is None:
            return self._still(ControlReason.NO_JOINTS)
        if pose is None or not is_fresh(pose.stamp_ns, self.parameters.max_pose_age_ns, now_ns):
            return self._still(ControlReason.NO_POSE)
        if wrench is None or not self._is_usable(wrench, now_ns):
            return self._still(ControlReason.NO_WRENCH)
        try:
            base_from_tip, jacobian = self._tool.evaluate(positions)
        except MarginGuardError:  # a loop that does not close at the measured positions
            return self._still(ControlReason.NO_JOINTS)
        force, torque = wrench.force_n, wrench.torque_n_m
        if wrench.in_tool:
            force, torque = base_from_tip.rotate(force), base_from_tip.rotate(torque)
        desired = self._hand.twist(force, torque, now_ns)
        rule_from_base = pose.rule_from_base
        decision = self._rule.allow_joints(
            turned(rule_from_base.rotation, desired),
            rule_from_base.apply(base_from_tip.translation_mm),
            turned(rule_from_base.rotation, jacobian),
            positions,
            self._limits,
            now_ns,
        )
        if self._latched:
            return self._still(ControlReason.WATCHDOG, decision.reason)
        if decision.permission is RulePermission.NO_MOTION:
            return self._still(ControlReason.RULE, decision.reason)
        is_free = decision.permission is RulePermission.WITHIN_PLANES
        reason = ControlReason.FOLLOWS if is_free else ControlReason.RULE
        return ControlDecision(
            self._tool.joints, decision.velocities, reason, decision.reason, desired
        )

    def _watch(self, now_ns: int) -> None:
        """Latch after `watchdog_ns` without a valid constraint, once there has been one."""
        self._rule.stand(now_ns)  # until this step allows more
        permission, reason = self._rule.permission(now_ns)
        # Another tumour or registration is used from the next poses on.
        if permission is not RulePermission.NO_MOTION or reason is RuleReason.SETUP_CHANGED:
            self._valid_ns = now_ns
        elif self._valid_ns is not None:
            # A negative age is that of a clock that was set back.
            age_ns = now_ns - self._valid_ns
            self._latched = self._latched or not 0 <= age_ns <= self.parameters.watchdog_ns

    def _is_usable(self, wrench: WrenchMeasurement, now_ns: int) -> bool:
        values = (np.asarray(wrench.force_n), np.asarray(wrench.torque_n_m))
        return is_fresh(wrench.stamp_ns, self.parameters.max_wrench_age_ns, now_ns) and all(
            each.shape == (3,) and all(map(math.isfinite, each.tolist())) for each in values
        )

    def _still(self, reason: ControlReason, rule: RuleReason | None = None) -> ControlDecision:
        """No motion; the hand starts from rest again."""
        self._hand.reset()
        if self._latched:
            reason = ControlReason.WATCHDOG
        return ControlDecision(
            self._tool.joints, np.zeros(len(self._tool.joints)), reason, rule, np.zeros(6)
        )


def positions_of(
    measured: JointMeasurement | None, joints: tuple[str, ...], max_age_ns: int, now_ns: int
) -> FloatArray | None:
    """Positions (n,) of ``joints``; None if one is missing, old or not finite."""
    if measured is None or len(measured.names) != len(measured.positions):
        return None
    if not is_fresh(measured.stamp_ns, max_age_ns, now_ns):
        return None
    named = dict(zip(measured.names, measured.positions, strict=True))
    if len(named) != len(measured.names):
        return None
    found = [named.get(name, math.nan) for name in joints]
    return np.array(found, dtype=np.float64) if all(map(math.isfinite, found)) else None


def is_fresh(stamp_ns: int, max_age_ns: int, now_ns: int) -> bool:
    """True for a measurement that is not too old; one from the future is an error of a clock."""
    return freshness_of(stamp_ns, now_ns, _limits_of(max_age_ns)) is Freshness.VALID


_limits_of = cache(FreshnessLimits)


def turned(rotation: FloatArray, rows: FloatArray) -> FloatArray:
    """``rows`` (6, ...) of two stacked vectors in other axes."""
    return np.asarray((rotation @ rows.reshape(2, 3, -1)).reshape(rows.shape))
