"""Straight needle corridors from the skin to a target, and guidance of a needle along one."""

from collections.abc import Sequence

from app import planning
from app.geometry import FloatArray
from app.planning import (
    Corridor,
    EntryRegion,
    ForbiddenStructure,
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
from marginguard.values import checked, checked_list

__all__ = [
    "Corridor",
    "EntryRegion",
    "ForbiddenStructure",
    "Needle",
    "NeedleGuidance",
    "NeedlePath",
    "NeedlePlan",
    "NeedleRobot",
    "NeedleTarget",
    "NoCorridorError",
    "guide_needle",
    "needle_constraint",
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
