"""Insertion of a needle by a robot: joint positions from the entry to the target."""

import math
from dataclasses import dataclass

import numpy as np

from app.geometry import FloatArray, FrameError, Transform
from app.robot import IkOptions, Robot, UnreachableError

_STEP_MM = 5.0
_TURNS = 12
"""Turns about the needle that are tried: it is round."""

_AT_ENTRY = IkOptions(restarts=20)
_ON_THE_WAY = IkOptions(restarts=0)
_MAX_STEP_RAD = 0.35
"""A joint that turns by more between two steps has changed to another branch."""


@dataclass(frozen=True, slots=True, eq=False)
class NeedleRobot:
    """A robot that holds the needle, with its base at rest.

    ``frame_from_root`` places the robot's root link in the frame of the plan. ``link_from_tip``
    places the tip of the needle in the link that holds it; +z points from the hub to the tip.
    Raises `FrameError` for a transform of other frames.

    >>> import numpy as np
    >>> import marginguard as mg
    >>> arm = mg.open_case(mg.example_case()).setup.robot
    >>> reference_from_root = arm.registration.transform.renamed(source=arm.robot.root_link)
    >>> robot = mg.NeedleRobot(arm.robot, reference_from_root, arm.link_from_tip)
    >>> entry, target = np.array([-15.0, -133.0, -27.0]), np.array([-5.0, -119.0, -63.0])
    >>> len(robot.insertion(entry, target)), robot.insertion(20.0 * entry, target)
    (9, ())
    """

    robot: Robot
    frame_from_root: Transform
    link_from_tip: Transform

    def __post_init__(self) -> None:
        if self.frame_from_root.source != self.robot.root_link:
            raise FrameError(
                f"frame_from_root: is from {self.frame_from_root.source!r}; "
                f"expected from {self.robot.root_link!r}"
            )
        self.robot.joints_that_move(self.link_from_tip.target)

    def insertion(
        self, entry_mm: FloatArray, target_mm: FloatArray
    ) -> tuple[dict[str, float], ...]:
        """Joint positions (rad, m) at steps of at most 5 mm; empty if the robot cannot do it.

        All are within the limits of the joints, and no joint changes to another branch on the way.
        Collisions of the arm are not checked.
        """
        depth = float(np.linalg.norm(target_mm - entry_mm))
        z = (target_mm - entry_mm) / depth
        parts = np.linspace(0.0, 1.0, max(2, math.ceil(depth / _STEP_MM) + 1))
        x0, y0 = np.linalg.svd(z[None])[2][1:]
        for turn in np.arange(_TURNS) * (math.tau / _TURNS):
            x = math.cos(turn) * x0 + math.sin(turn) * y0
            rotation = np.column_stack([x, np.cross(z, x), z])
            tips = [entry_mm + part * (target_mm - entry_mm) for part in parts]
            found = self._follow(rotation, tips)
            if found:
                return found
        return ()

    def _follow(
        self, rotation: FloatArray, tips_mm: list[FloatArray]
    ) -> tuple[dict[str, float], ...]:
        link, tip = self.link_from_tip.target, self.link_from_tip.source
        path: list[dict[str, float]] = []
        for place in tips_mm:
            pose = Transform(self.frame_from_root.target, tip, rotation, place)
            goal = self.frame_from_root.inverse() @ pose @ self.link_from_tip.inverse()
            seed, options = (path[-1], _ON_THE_WAY) if path else (None, _AT_ENTRY)
            try:
                joints = self.robot.inverse_kinematics(link, goal, seed=seed, options=options)
            except UnreachableError:
                return ()
            if path and max(abs(joints[k] - path[-1][k]) for k in joints) > _MAX_STEP_RAD:
                return ()
            path.append(joints)
        return tuple(path)
