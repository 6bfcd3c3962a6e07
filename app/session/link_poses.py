"""Poses of a robot's links, from its joints or, without joints, by following the tracked tool."""

import math
from collections.abc import Mapping
from functools import lru_cache

from app.case import JointSample, TrackingFrame
from app.geometry import Freshness, FreshnessLimits, Transform, freshness_of_stamp
from app.robot import IkOptions, JointError, UnreachableError
from app.session.setup import RobotSetup

OPTIONS = IkOptions(tolerance_mm=1e-3, tolerance_rad=1e-5, max_iterations=30, restarts=0)
"""Accuracy for display. Seeds of the last frame keep the solution on its branch."""

OUT_OF_REACH = "the tool is out of the robot's reach"


class RobotLinks:
    """Poses of all links of ``robot`` at each step; ``joints`` are the latest that place the tool.

    Joints that do not determine the tool link, such as those of a gripper, are not used.
    """

    def __init__(self, robot: RobotSetup | None) -> None:
        self.joints: JointSample | None = None
        self.use(robot)

    def use(self, robot: RobotSetup | None) -> None:
        """Replace the robot."""
        self._robot = robot
        self._follower = IkFollower(robot) if robot is not None and robot.follows_tool else None
        is_posed_by = (lambda _: True) if robot is None else robot.is_posed_by
        self._is_posed_by = lru_cache(maxsize=8)(is_posed_by)

    def at(
        self, frame: TrackingFrame, reference_from_tip: Transform | None, limits: FreshnessLimits
    ) -> tuple[Mapping[str, Transform], str]:
        """``root_from_link`` of all links from the latest joints, or none and the problem.

        Without recorded joints: by inverse kinematics of the tracked ``reference_from_tip``.
        """
        robot = self._robot
        for sample in reversed(frame.joints):
            if self._is_posed_by(sample.names):
                self.joints = sample
                break
        if robot is None:
            return {}, ""
        if robot.follows_tool:
            return self._followed(reference_from_tip)
        if self.joints is None:
            return {}, _incomplete(robot, frame) or "no joint positions yet"
        if freshness_of_stamp(self.joints.stamp, frame.stamp, limits) is not Freshness.VALID:
            return {}, "joint positions are stale or from the future"
        try:
            positions = self.joints.as_mapping()
            return robot.robot.measured_kinematics(robot.tool_link, positions), ""
        except JointError as error:
            return {}, str(error)

    def _followed(
        self, reference_from_tip: Transform | None
    ) -> tuple[Mapping[str, Transform], str]:
        if self._follower is None or reference_from_tip is None:
            return {}, "the tool is not seen in the reference frame: the robot cannot follow it"
        try:
            return self._follower.links(reference_from_tip), ""
        except UnreachableError as error:
            return {}, f"{OUT_OF_REACH}: {error}"


def _incomplete(robot: RobotSetup, frame: TrackingFrame) -> str:
    """The error of the newest joints of ``frame`` that do not place the tool link; or empty."""
    try:
        for sample in frame.joints[-1:]:
            robot.robot.measured_kinematics(robot.tool_link, sample.as_mapping())
    except JointError as error:
        return str(error)
    return ""


class IkFollower:
    """Solves for joint positions that bring the robot's tool link to the tool, frame by frame.

    ``robot.registration`` places the base. If ``robot.link_from_tip`` is None, the link takes the
    orientation of the tip. Each search starts at the last solution; every third failure in a row
    is followed by one search from another start, so that a lost tool is found again and a single
    bad frame does not change the branch.
    """

    def __init__(self, robot: RobotSetup) -> None:
        self._robot = robot
        self._seed: dict[str, float] = {}
        self._failures = 0

    def links(self, reference_from_tip: Transform) -> Mapping[str, Transform]:
        """``root_from_link`` of every link; raises `UnreachableError`."""
        setup = self._robot
        if setup.registration is None:
            raise UnreachableError(f"robot {setup.robot.name!r} is not registered")
        base_from_tip = setup.registration.transform.inverse() @ reference_from_tip
        if setup.link_from_tip is not None:
            base_from_tip = base_from_tip @ setup.link_from_tip.inverse()
        root_from_link = base_from_tip.renamed(target=setup.robot.root_link, source=setup.tool_link)
        # One search per frame bounds the cost when the tool is out of reach.
        start = self._other_start() if self._failures % 3 == 2 else self._seed
        try:
            self._seed = setup.robot.inverse_kinematics(
                setup.tool_link, root_from_link, seed=start, options=OPTIONS
            )
        except UnreachableError:
            self._failures += 1
            raise
        self._failures += -self._failures % 3
        return setup.robot.forward_kinematics(self._seed)

    def _other_start(self) -> dict[str, float]:
        """Low-discrepancy joint positions, one new set per failure.

        Multiples of square roots of primes modulo 1, scaled to the joint ranges (Richtmyer 1951).
        """
        robot, start = self._robot.robot, {}
        joints = [joint for joint in robot.joints if joint.name in robot.actuated_joint_names]
        for joint, root in zip(joints, _square_roots_of_primes(len(joints)), strict=True):
            low = joint.lower if math.isfinite(joint.lower) else -math.pi
            high = joint.upper if math.isfinite(joint.upper) else math.pi
            start[joint.name] = low + (high - low) * (self._failures * root % 1.0)
        return start


def _square_roots_of_primes(count: int) -> list[float]:
    primes: list[int] = []
    number = 2
    while len(primes) < count:
        if all(number % prime for prime in primes):
            primes.append(number)
        number += 1
    return [math.sqrt(prime) for prime in primes]
