"""A robot whose joints were not recorded follows the recorded tool by inverse kinematics."""

import math
from collections.abc import Mapping

from app.geometry import Transform
from app.robot import IkOptions, UnreachableError
from app.session.setup import RobotSetup

OPTIONS = IkOptions(tolerance_mm=1e-3, tolerance_rad=1e-5, max_iterations=30, restarts=0)
"""Fine enough to be shown. A tool that moves steadily leaves the robot on its branch."""

OUT_OF_REACH = "the tool is out of the robot's reach"


class IkFollower:
    """Finds joints that bring the robot's tool link to the tool, frame after frame.

    ``robot.registration`` says where its base is. Where ``robot.link_from_tip`` is not known, the
    link is turned as the tip is. A frame is tried from the last solution; after two that failed one
    is tried from another start, and so on in turns, so that a robot that has lost the tool finds
    it again, and does not leave its branch for one bad frame.
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
        # In turns, so that a frame costs one search whether or not the tool is in reach.
        start = self._other_start() if self._failures % 3 == 2 else self._seed
        try:
            self._seed = setup.robot.inverse_kinematics(
                setup.tool_link, wanted, seed=start, options=OPTIONS
            )
        except UnreachableError:
            self._failures += 1
            raise
        self._failures += -self._failures % 3
        return setup.robot.forward_kinematics(self._seed)

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
