"""Robots, and approaches in joint space that touch nothing."""

import math
import os
import time
from collections.abc import Callable, Mapping, Sequence

from app import planning, robot
from app.geometry import InputError, SurfaceMesh, Transform
from app.planning import Approach, ApproachError, MotionLimits
from app.robot import Robot
from marginguard.values import as_path, checked, needs

__all__ = ["Approach", "ApproachError", "MotionLimits", "Robot", "load_robot", "plan_approach"]


def load_robot(
    path: str | os.PathLike[str], *, package_dirs: Sequence[str | os.PathLike[str]] = ()
) -> Robot:
    """Load a robot file: URDF, xacro or AMBF. ``docs/robots.md`` says where its meshes are found.

    Raises `MarginGuardError` for a file that cannot be read or is not one tree of links.
    """
    folders = [as_path(folder, "package_dirs") for folder in package_dirs]
    return robot.load_robot(as_path(path, "path"), package_dirs=folders)


def plan_approach(
    robot: Robot,
    start: Mapping[str, float],
    goal: Mapping[str, float] | Transform,
    structures: Mapping[str, SurfaceMesh],
    *,
    clearance_mm: float,
    limits: Mapping[str, MotionLimits],
    carried: Mapping[str, SurfaceMesh] | None = None,
    allowed_s: float = 10.0,
    is_cancelled: Callable[[], bool] = lambda: False,
    made_from: Mapping[str, str] | None = None,
) -> Approach:
    """Plan a motion of ``robot`` that keeps ``clearance_mm`` from ``structures``, all the way.

    ``start`` has the positions of all actuated joints, in rad, for sliding joints in m. ``goal``
    has those of the joints that move, or is the pose of a link in the root link. ``structures`` are
    closed surfaces in the root link's frame, ``carried`` bodies in the frame of the link that
    carries each. ``limits`` are those of each moving joint. ``made_from`` are ids, such as those of
    registration and structures, for `Approach.is_valid_for`.

    Raises `ApproachError` for a start or goal in collision, a goal out of reach, and no path within
    ``allowed_s`` or before ``is_cancelled``, another `MarginGuardError` for other values.
    ``docs/planning_approach.md`` says what is tested.

    >>> import trimesh
    >>> import marginguard as mg
    >>> arm: mg.Robot = mg.load_robot(mg.example_case().parent / "robots" / "touch" / "touch.urdf")
    >>> start = {**dict.fromkeys(arm.actuated_joint_names, 0.0), "elbow": 0.5, "waist": -0.5}
    >>> goal = {**start, "waist": 0.5}
    >>> limits = {joint: mg.MotionLimits(acceleration=5.0, jerk=50.0) for joint in start}
    >>> shape = trimesh.creation.icosphere(3, 20.0)
    >>> def plan(center_mm) -> mg.Approach:
    ...     ball = mg.SurfaceMesh(arm.root_link, shape.vertices + center_mm, shape.faces)
    ...     return mg.plan_approach(
    ...         arm, start, goal, {"ball": ball},
    ...         clearance_mm=5.0, limits=limits, made_from={"ball": "1"},
    ...     )
    >>> approach = plan([0.0, 0.0, 900.0])
    >>> approach.joints == tuple(start), approach.is_valid_for({"ball": "2"})
    (True, False)
    >>> try:
    ...     plan([117.0, -64.0, 150.0])
    ... except mg.ApproachError as error:
    ...     print(error)
    start: upper_arm is 0.00 mm from ball; expected at least 5 mm
    """
    checked(robot, Robot, "robot")
    if not (math.isfinite(allowed_s) and allowed_s > 0.0):
        raise InputError(f"allowed_s: is {allowed_s}; expected a number above 0")
    end_s = time.monotonic() + allowed_s
    with needs("the planning of approaches"):
        return planning.plan_approach(
            robot,
            start,
            goal,
            structures,
            clearance_mm=clearance_mm,
            limits=limits,
            carried=carried,
            is_over=lambda: time.monotonic() > end_s or is_cancelled(),
            made_from=made_from,
        )
