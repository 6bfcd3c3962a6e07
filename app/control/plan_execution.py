"""Execution of a planned motion, supervised by the fixture's rule.

The motion keeps to its path, which was proven. The rule only slows it down. Whatever is missing,
late, on hold or another than planned stops it for good.

The rule's time constant tau is not below the time in which the joints can stop. So a plane at the
clearance c, which is approached at most at c / tau, slows the motion down no faster than its
accelerations allow, and a stop there ends after c / 2.
"""

from collections import deque
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from app.control.control_file import RULE_FRAME, ControlDescription
from app.control.controller import JointMeasurement, PoseMeasurement, is_fresh, positions_of, turned
from app.control.path_follower import PathFollower, PlannedMotion
from app.fixture import FixtureRule, LimiterParameters, PlainConstraint, RulePermission, RuleReason
from app.geometry import NS_PER_MS, NS_PER_S, FloatArray, InputError, MarginGuardError

MIN_TAU_S = 0.1
"""Time constant of the rule: an arm follows a position later than a velocity."""

START_RAD, START_M = 0.002, 0.0002
"""Largest distance of a joint from the start of the plan."""

FOLLOW_RAD, FOLLOW_M = 0.01, 0.001
"""Largest distance of a joint from the path."""

MEMORY_NS = 200 * NS_PER_MS
"""An arm that is farther behind its commands does not follow them."""

LATE_NS = 100 * NS_PER_MS
"""A measurement that is late brakes the motion at once, and ends it after this time."""

BLOCKED_NS = 2 * NS_PER_S
_LEAST_RATE = 0.01


class Outcome(StrEnum):
    """Reason why a motion has ended."""

    ARRIVED = "arrived"
    CANCELLED = "cancelled"
    OTHER_SENDER = "other_sender"
    """Another node may move the arm."""
    RULE = "rule"
    """The constraint is missing, invalid, too old, on hold or of another guard."""
    OTHER_SETUP = "other_setup"
    """Tumour, structures or registration are not those that the plan was made for."""
    NO_JOINTS = "no_joints"
    NO_POSE = "no_pose"
    OFF_PATH = "off_path"
    """The arm does not follow."""
    OBSTACLE = "obstacle"
    """The rest of the path is not proven against the obstacles of other nodes."""
    BLOCKED = "blocked"
    """The planes have allowed no motion along the path for 2 s."""


_LATE = (Outcome.NO_JOINTS, Outcome.NO_POSE)


@dataclass(frozen=True, slots=True, eq=False)
class ExecutionStep:
    """Positions (n,) of all joints to send now, and velocities (n,), in the order of the arm.

    ``progress`` is the share of the planned time that is behind. ``outcome`` is the reason why the
    motion ends or has ended, with ``text``; ``is_over`` when nothing more is to be sent.
    """

    positions: FloatArray
    velocities: FloatArray
    progress: float
    outcome: Outcome | None
    text: str
    is_over: bool


class _Stop(NamedTuple):
    outcome: Outcome
    text: str


class PlanExecution:
    """Pure: `receive` at each constraint, `problem` before the first `step`. Use in one thread.

    Raises `InputError` for a plan of another robot or without the id of a setup.
    """

    def __init__(self, description: ControlDescription, motion: PlannedMotion) -> None:
        self._about, self._motion, self._tool = description, motion, description.tool
        if motion.robot != self._tool.robot.name:
            raise InputError(
                f"plan: is of robot {motion.robot!r}; expected {self._tool.robot.name!r}"
            )
        joints = self._tool.joints
        if {*motion.joints, *motion.held} != set(joints):
            raise InputError(
                f"plan: has the joints {', '.join((*motion.joints, *motion.held))}; expected "
                f"{', '.join(joints)}"
            )
        if not motion.setup_id:
            raise InputError("plan: has no setup_id; expected one made with --guard")
        self._moving = np.array([joints.index(name) for name in motion.joints])
        self._follower = PathFollower(motion, self._checked_speeds())
        self._rule = FixtureRule(
            frame=RULE_FRAME,
            parameters=LimiterParameters(
                tau_s=max(MIN_TAU_S, self._follower.stop_s),
                max_speed_mm_s=description.max_speed_mm_s,
            ),
            accept_simulated=description.accept_simulated,
        )
        self._held = np.array([motion.held.get(name, 0.0) for name in joints])
        slides = self._tool.slides
        self._start_tolerance = np.where(slides, START_M, START_RAD)
        self._follow_tolerance = np.where(slides, FOLLOW_M, FOLLOW_RAD)
        self._sent: deque[tuple[int, FloatArray]] = deque()
        self._steady_ns: int | None = None
        self._usable_ns = 0
        self._twists = np.zeros((6, len(motion.joints)))
        """Jacobian of the moving joints in the rule's frame, when it was last known."""
        self._ended: _Stop | None = None
        self._standing_ns: int | None = None

    def _checked_speeds(self) -> FloatArray:
        """Largest speeds (d,); raises `InputError` for a joint beyond the limits of the arm."""
        limits = self._tool.limits(self._about.parameters.max_joint_speed)
        lowest, highest = self._motion.positions.min(axis=0), self._motion.positions.max(axis=0)
        fastest = np.abs(self._motion.velocities).max(axis=0)
        for column, joint in enumerate(self._moving.tolist()):
            low, high, speed = (
                float(each[joint]) for each in (limits.lower, limits.upper, limits.max_speed)
            )
            if lowest[column] < low or highest[column] > high or fastest[column] > speed:
                raise InputError(
                    f"plan: moves joint {self._motion.joints[column]!r} between "
                    f"{lowest[column]:g} and {highest[column]:g} with up to {fastest[column]:g} "
                    f"per s; expected {low:g} to {high:g}, at most {speed:g} per s"
                )
        for name, planned in zip(self._motion.joints, self._motion.accelerations, strict=True):
            allowed = self._about.joint_limits.get(name)
            if allowed is not None and planned > allowed.acceleration:
                raise InputError(
                    f"plan: accelerates joint {name!r} by up to {planned:g} per s2; expected at "
                    f"most {allowed.acceleration:g} per s2"
                )
        return np.asarray(limits.max_speed[self._moving])

    @property
    def constraint(self) -> PlainConstraint | None:
        """The constraint in use; None before the first one."""
        return self._rule.message

    def receive(self, constraint: PlainConstraint, now_ns: int) -> None:
        """Use ``constraint``, which has just arrived."""
        self._rule.receive(constraint, now_ns)

    def end(self, outcome: Outcome, text: str) -> None:
        """Stop within the accelerations of the plan, for good; the first call counts."""
        if self._ended is None:
            self._ended = _Stop(outcome, text)

    def problem(
        self, joints: JointMeasurement | None, pose: PoseMeasurement | None, now_ns: int
    ) -> str:
        """The problem for which the motion may not begin; empty without one."""
        checked = self._check(joints, pose, now_ns)
        if isinstance(checked, _Stop):
            return checked.text
        positions = self._positions(joints, now_ns)
        assert positions is not None  # else `_check` has found it
        planned = self._all(self._follower.positions)
        far = np.abs(positions - planned) > self._start_tolerance
        if far.any():
            index = int(np.flatnonzero(far)[0])
            return (
                f"joint {self._tool.joints[index]!r}: is at {positions[index]:.4f}, the plan "
                f"begins at {planned[index]:.4f}; expected at most "
                f"{self._start_tolerance[index]:g} between them"
            )
        return ""

    def step(
        self,
        joints: JointMeasurement | None,
        pose: PoseMeasurement | None,
        now_ns: int,
        steady_ns: int,
        *,
        is_paused: bool = False,
    ) -> ExecutionStep:
        """The command at ``now_ns``: the next place on the path, or a stop on it if ``is_paused``.

        ``now_ns`` is on the clock of the stamps. The motion follows ``steady_ns``, of a clock that
        is never set: otherwise it would jump with the other one.
        """
        if self._steady_ns is None:
            self._steady_ns = self._usable_ns = steady_ns
        elapsed_ns, self._steady_ns = steady_ns - self._steady_ns, steady_ns
        share = 0.0
        checked = self._check(joints, pose, now_ns)
        if not isinstance(checked, _Stop):
            share, self._twists = checked
            self._usable_ns = steady_ns
        elif checked.outcome not in _LATE or steady_ns - self._usable_ns > LATE_NS:
            self.end(*checked)
        if self._ended is not None or is_paused:
            share = 0.0
        self._follower.step(share, elapsed_ns)
        velocities = self._follower.rate * self._follower.planned_velocities
        self._rule.command(self._twists @ velocities, now_ns)
        sent = self._all(self._follower.positions)
        self._sent.append((steady_ns, sent))
        while steady_ns - self._sent[0][0] > MEMORY_NS:
            self._sent.popleft()
        is_over = self._is_over(steady_ns, is_paused)
        moving = np.zeros(len(sent))
        moving[self._moving] = velocities
        outcome, text = self._ended or (None, "")
        return ExecutionStep(sent, moving, self._follower.progress, outcome, text, is_over)

    def _is_over(self, steady_ns: int, is_paused: bool) -> bool:
        """True once the last command has been sent for so long that the arm has followed."""
        is_at_end = self._follower.progress >= 1.0
        is_moving = self._follower.rate > _LEAST_RATE and not is_at_end
        if is_moving or (is_paused and self._ended is None):
            self._standing_ns = None
            return False
        if self._standing_ns is None:
            self._standing_ns = steady_ns
        for_ns = steady_ns - self._standing_ns
        if is_at_end and for_ns > MEMORY_NS:
            self.end(Outcome.ARRIVED, "arrived")
        if for_ns > BLOCKED_NS:
            self.end(
                Outcome.BLOCKED,
                "constraint: its planes allow no motion along the path; expected room",
            )
        is_still = is_at_end or self._follower.rate == 0.0
        return self._ended is not None and is_still and for_ns > MEMORY_NS

    def _check(
        self, joints: JointMeasurement | None, pose: PoseMeasurement | None, now_ns: int
    ) -> tuple[float, FloatArray] | _Stop:
        """The share of the planned velocities that is allowed, and the Jacobian (6, d).

        That is along the axes of the rule's frame. Otherwise the reason to stop, with a text.
        """
        parameters = self._about.parameters
        positions = self._positions(joints, now_ns)
        if positions is None:
            return _Stop(
                Outcome.NO_JOINTS,
                f"joints of {self._about.arm}: no usable positions; expected all joints, at most "
                f"{parameters.max_joints_age_ns / NS_PER_MS:g} ms old",
            )
        message = self._rule.message
        if message is not None and message.setup_id != self._motion.setup_id:
            return _Stop(
                Outcome.OTHER_SETUP,
                f"guard: has the setup {message.setup_id!r}; expected {self._motion.setup_id!r} "
                "of the plan, or a new plan",
            )
        permission, reason = self._rule.permission(now_ns)
        if permission is not RulePermission.WITHIN_PLANES:
            return _stop_of(reason)
        if pose is None or not is_fresh(pose.stamp_ns, parameters.max_pose_age_ns, now_ns):
            return _Stop(
                Outcome.NO_POSE,
                "base of the arm: no usable pose in the tumour's frame; expected one, at most "
                f"{parameters.max_pose_age_ns / NS_PER_MS:g} ms old",
            )
        if self._sent and self._distance_from_path(positions) > 1.0:
            return _Stop(
                Outcome.OFF_PATH,
                f"joints of {self._about.arm}: do not follow; expected them at most "
                f"{FOLLOW_RAD:g} rad or {1000.0 * FOLLOW_M:g} mm from the path",
            )
        try:
            base_from_tip, jacobian = self._tool.evaluate(positions)
        except MarginGuardError as error:  # a loop that does not close
            return _Stop(Outcome.NO_JOINTS, str(error))
        rule_from_base = pose.rule_from_base
        twists = turned(rule_from_base.rotation, jacobian[:, self._moving])
        decision = self._rule.allow_share(
            twists @ self._follower.planned_velocities,
            rule_from_base.apply(base_from_tip.translation_mm),
            now_ns,
        )
        if decision.permission is not RulePermission.WITHIN_PLANES:
            return _stop_of(decision.reason)
        return decision.share, twists

    def _positions(self, joints: JointMeasurement | None, now_ns: int) -> FloatArray | None:
        max_age_ns = self._about.parameters.max_joints_age_ns
        return positions_of(joints, self._tool.joints, max_age_ns, now_ns)

    def _distance_from_path(self, positions: FloatArray) -> float:
        """Distance from the lines between the last commands, in units of the tolerance."""
        places = np.array([each for _, each in self._sent]) / self._follow_tolerance
        start, line = places[:-1], np.diff(places, axis=0)
        away = positions / self._follow_tolerance - places
        length2 = np.maximum((line * line).sum(axis=1), 1e-12)
        along = np.clip((away[:-1] * line).sum(axis=1) / length2, 0.0, 1.0)
        nearest = np.concatenate([start + along[:, None] * line, places[-1:]])
        offsets = np.abs(positions / self._follow_tolerance - nearest)
        return float(offsets.max(axis=1).min())

    def _all(self, moving: FloatArray) -> FloatArray:
        """Positions (n,) of all joints."""
        found = self._held.copy()
        found[self._moving] = moving
        return found


def _stop_of(reason: RuleReason) -> _Stop:
    return _Stop(Outcome.RULE, f"constraint: {reason}; expected one that allows motion")
