"""Plans: straight needle corridors with guidance along one, and approaches in joint space."""

import math
import os
import time
from collections.abc import Callable, Mapping, Sequence

from app import planning, robot
from app.geometry import FloatArray, InputError, SurfaceMesh, Transform
from app.planning import (
    Approach,
    ApproachError,
    Corridor,
    EntryRegion,
    ForbiddenStructure,
    MotionLimits,
    Needle,
    NeedleGuidance,
    NeedlePath,
    NeedlePlan,
    NeedleRobot,
    NeedleTarget,
    NoCorridorError,
    guide_needle,
    needle_constraint,
)
from app.robot import Robot
from marginguard.values import as_path, checked, checked_list, needs

__all__ = [
    "Approach",
    "ApproachError",
    "Corridor",
    "EntryRegion",
    "ForbiddenStructure",
    "MotionLimits",
    "Needle",
    "NeedleGuidance",
    "NeedlePath",
    "NeedlePlan",
    "NeedleRobot",
    "NeedleTarget",
    "NoCorridorError",
    "Robot",
    "guide_needle",
    "load_robot",
    "needle_constraint",
    "plan_approach",
    "plan_needle",
]


def plan_needle(
    region: EntryRegion,
    target: NeedleTarget,
    needle: Needle,
    structures: Sequence[ForbiddenStructure],
    *,
    error: float | FloatArray,
    k_sigma: float,
    robot: NeedleRobot | None = None,
) -> NeedlePlan:
    """Find the best corridor from ``region`` to ``target``, and up to three distinct others.

    All are in one frame. ``error`` is that of the needle's place at the target: a standard
    deviation in mm along each axis, or a covariance (3, 3) in mm2. From each structure the needle
    keeps ``stop_mm`` and ``k_sigma`` standard deviations. With `NeedleRobot` only corridors along
    which it can insert the needle are offered. Raises `NoCorridorError` if there is none, and
    another `MarginGuardError` for other values. ``docs/planning.md`` has the score.

    >>> import trimesh
    >>> import marginguard as mg
    >>> def ball(name, z_mm, radius_mm):
    ...     shape = trimesh.creation.icosphere(3, radius_mm)
    ...     surface = mg.SurfaceMesh("ct", shape.vertices + [0, 0, z_mm], shape.faces)
    ...     return mg.ForbiddenStructure(name, surface, stop_mm=2.0, sigma_mm=0.5)
    >>> region = mg.EntryRegion.of_disc("ct", [0, 0, 60], [0, 0, 1], 40.0, count=5000)
    >>> target = mg.NeedleTarget.of_points("ct", [[0, 0, 0]])
    >>> needle = mg.Needle(length_mm=100.0, diameter_mm=1.2, bend_mm=1.0)
    >>> def plan(structure) -> mg.NeedlePlan:
    ...     return mg.plan_needle(region, target, needle, [structure], error=1.0, k_sigma=2.0)
    >>> best: mg.Corridor = plan(ball("vessel", 30.0, 8.0)).best
    >>> vessel = best.structures[0]
    >>> vessel.clearance_mm >= vessel.required_mm, vessel.hit_probability < 0.01
    (True, True)
    >>> try:
    ...     plan(ball("cyst", 0.0, 20.0))
    ... except mg.NoCorridorError as error:
    ...     print(error)
    corridor: none of 5000 entries is allowed, cyst blocks 5000; expected at least one
    """
    checked(region, EntryRegion, "region")
    checked(target, NeedleTarget, "target")
    checked(needle, Needle, "needle")
    if robot is not None:
        checked(robot, NeedleRobot, "robot")
    return planning.plan_needle(
        region,
        target,
        needle,
        checked_list(structures, ForbiddenStructure, "structures"),
        error=error,
        k_sigma=k_sigma,
        robot=robot,
    )


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
