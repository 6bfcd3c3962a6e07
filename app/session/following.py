"""A robot whose joints were not recorded follows the recorded tool by inverse kinematics."""

from collections.abc import Mapping

from app.geometry import Transform
from app.robot import IkOptions, UnreachableError
from app.session.setup import RobotSetup

NEAR = IkOptions(tolerance_mm=1e-3, tolerance_rad=1e-5, max_iterations=50, restarts=0)
"""From the last solution: a tool that moves steadily leaves the robot on its branch."""

ANEW = IkOptions(tolerance_mm=1e-3, tolerance_rad=1e-5, max_iterations=50, restarts=10)
"""Where there is no last solution, or it does not lead to the pose."""


class IkFollower:
    """Finds joints that bring the robot's tool link to the tool, frame after frame.

    ``robot.registration`` says where its base is. Where ``robot.link_from_tip`` is not known, the
    link is turned as the tip is. While no joints are found every frame is tried from the last
    solution alone, but for the first of them, so that a tool out of reach does not hold up a
    replay.
    """

    def __init__(self, robot: RobotSetup) -> None:
        self._robot = robot
        self._seed: dict[str, float] | None = None
        self._is_lost = False

    def links(self, reference_from_tip: Transform) -> Mapping[str, Transform]:
        """``root_from_link`` of every link; `UnreachableError` with how near the robot comes."""
        setup = self._robot
        if setup.registration is None:
            raise UnreachableError(f"robot {setup.robot.name!r} is not registered")
        base_from_tip = setup.registration.transform.inverse() @ reference_from_tip
        if setup.link_from_tip is not None:
            base_from_tip = base_from_tip @ setup.link_from_tip.inverse()
        wanted = base_from_tip.renamed(target=setup.robot.root_link, source=setup.tool_link)
        self._seed = self._solution(wanted)
        return setup.robot.forward_kinematics(self._seed)

    def _solution(self, wanted: Transform) -> dict[str, float]:
        robot, link = self._robot.robot, self._robot.tool_link
        if self._seed is not None:
            try:
                found = robot.inverse_kinematics(link, wanted, seed=self._seed, options=NEAR)
            except UnreachableError:
                if self._is_lost:
                    raise
            else:
                self._is_lost = False
                return found
        self._is_lost = True
        found = robot.inverse_kinematics(link, wanted, seed=self._seed, options=ANEW)
        self._is_lost = False
        return found
