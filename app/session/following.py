"""A robot whose joints were not recorded follows the recorded tool by inverse kinematics."""

import math
from collections.abc import Mapping

from app.geometry import Transform
from app.robot import IkOptions, UnreachableError
from app.session.setup import RobotSetup

OPTIONS = IkOptions(tolerance_mm=1e-3, tolerance_rad=1e-5, max_iterations=30, restarts=0)
"""Fine enough to be shown. A tool that moves steadily leaves the robot on its branch."""


class IkFollower:
    """Finds joints that bring the robot's tool link to the tool, frame after frame.

    ``robot.registration`` says where its base is. Where ``robot.link_from_tip`` is not known, the
    link is turned as the tip is. Each frame is tried from the last solution; where that fails, from
    one other start as well, another one at each frame, so that a frame takes a few tens of ms at
    most whether or not the tool is in reach, and a robot that has lost it finds it again.
    """

    def __init__(self, robot: RobotSetup) -> None:
        self._robot = robot
        self._seed: dict[str, float] = {}
        self._failures = 0

    def links(self, reference_from_tip: Transform) -> Mapping[str, Transform]:
        """``root_from_link`` of every link; `UnreachableError` with how near the robot comes."""
        setup = self._robot
        if setup.registration is None:
            raise UnreachableError(f"robot {setup.robot.name!r} is not registered")
        base_from_tip = setup.registration.transform.inverse() @ reference_from_tip
        if setup.link_from_tip is not None:
            base_from_tip = base_from_tip @ setup.link_from_tip.inverse()
        wanted = base_from_tip.renamed(target=setup.robot.root_link, source=setup.tool_link)
        try:
            self._seed = self._solution(wanted, self._seed)
        except UnreachableError as nearest:
            self._failures += 1
            try:
                self._seed = self._solution(wanted, self._other_start())
            except UnreachableError:
                raise nearest from None
        return setup.robot.forward_kinematics(self._seed)

    def _solution(self, wanted: Transform, seed: Mapping[str, float]) -> dict[str, float]:
        setup = self._robot
        return setup.robot.inverse_kinematics(setup.tool_link, wanted, seed=seed, options=OPTIONS)

    def _other_start(self) -> dict[str, float]:
        """Positions spread evenly over the joints' ranges, the next ones at each failure.

        Multiples of square roots of primes, modulo 1 (Richtmyer 1951).
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
