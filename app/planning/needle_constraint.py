"""Half-spaces that keep a needle on its path, for the limiter that guards the structures.

Three planes keep the tip, and three a second point of the shaft, in a triangle around the path's
axis; all points between the two are then inside, too. Another plane ends the advance at the target.
"""

import math

import numpy as np

from app.fixture.control.constraint import MAX_PLANES, Constraint
from app.fixture.proximity.values import FreeMotion
from app.geometry import FloatArray, FrameError, InputError, Transform
from app.planning.needle_guidance import NeedlePath

LEVER_MM = 20.0
"""The second point is where the shaft passes the entry, or as far behind the tip if that is more:
a needle that is not yet deep is held by its direction."""

_FREE = FreeMotion(5.0, 0.04)
"""A needle that turns and then slides leaves its planes by the product of both: by 0.05 mm where
each uses half of this.
"""

_SIDES = np.array([(math.cos(k * math.tau / 3.0), math.sin(k * math.tau / 3.0)) for k in range(3)])
"""Inward normals of the sides of the triangle, across the path."""


def needle_constraint(
    path: NeedlePath,
    frame_from_needle: Transform,
    *,
    tolerance_mm: float,
    may_advance: bool,
    guard: Constraint | None = None,
    shaft_mm: float = 0.0,
) -> Constraint:
    """The constraint that keeps the needle at ``frame_from_needle`` on ``path``, and of ``guard``.

    No point of the inserted shaft moves further than ``tolerance_mm`` from the axis, and the tip
    no deeper than the target; without ``may_advance`` (`NeedlePath.is_target_near`) it stays at its
    depth. Withdrawal is always allowed. The path is assumed at rest. The needle's frame has its
    origin at the tip, and +z points from the hub to the tip.

    ``guard`` is the constraint of the structures in the same frame. Its hold remains, and its
    nearest plane; the advance and the free motion end before one of the others is reached.
    ``shaft_mm``: the largest distance of a point of the tool from the tip, needed with ``guard``.

    Raises `FrameError` for poses and planes in another frame than the path's, and `InputError` for
    a pose that is not finite, a needle that points away from the target, and other values.

    >>> import marginguard as mg
    >>> path = mg.NeedlePath("ct", [0, 0, 0], [0, 0, 80])
    >>> needle = mg.Transform("ct", "needle", [[1, 0, 0], [0, 1, 0], [0, 0, 1]], [0, 0, 78])
    >>> planes = mg.needle_constraint(path, needle, tolerance_mm=1.0, may_advance=True)
    >>> push = [9.0, 0.0, 50.0, 0.0, 0.0, 0.0]
    >>> allowed = mg.limit_twist(push, planes, [0, 0, 78], mg.LimiterParameters())
    >>> allowed[:3].round(6).tolist()
    [9.0, 0.0, 40.0]
    """
    if not (math.isfinite(tolerance_mm) and tolerance_mm > 0.0):
        raise InputError(f"tolerance: is {tolerance_mm} mm; expected more than 0 mm")
    tip, axis = path.path_from_needle(frame_from_needle)
    if not axis[2] > 0.0:
        raise InputError("needle: points away from the target; expected less than 90 degrees")
    rows = _path_rows(tip, axis, path.depth_mm, tolerance_mm)
    free, ahead_mm = _FREE, math.inf if may_advance else 0.0
    if guard is not None:
        if guard.frame != path.frame:
            raise FrameError(f"guard: is in {guard.frame!r}; expected {path.frame!r} as the path")
        if not (math.isfinite(shaft_mm) and shaft_mm > 0.0):
            raise InputError(f"shaft: is {shaft_mm} mm; expected the tool's length from its tip")
        kept = MAX_PLANES - len(rows)
        order = np.argsort(guard.clearances_mm, kind="stable")
        next_mm = min(guard.clearances_mm[order[kept:]].tolist(), default=math.inf)
        # A limiter without delays does not use the free motion.
        ahead_mm = min(ahead_mm, max(next_mm, 0.0))
        free = FreeMotion(
            min(free.distance_mm, guard.free.distance_mm, max(next_mm, 0.0)),
            min(free.turn_rad, guard.free.turn_rad, max(next_mm, 0.0) / shaft_mm),
        )
    rows[-1, 0] = max(rows[-1, 0], -tip[2] - ahead_mm)
    rows = _placed(rows, path.frame_from_path)
    if guard is None:
        return Constraint.unchecked(path.frame, rows, hold=False, free=free)
    rows = np.concatenate([guard.rows[order[:kept]], rows])
    return Constraint.unchecked(path.frame, rows, hold=guard.hold, free=free)


def _path_rows(
    tip: FloatArray, axis: FloatArray, depth_mm: float, tolerance_mm: float
) -> FloatArray:
    """Rows (7, 10) of a constraint in the path's axes, the end of the advance last."""
    rows = np.zeros((7, 10))
    back_mm = max(tip[2] / axis[2], LEVER_MM)
    # A plane along the needle where it passes the entry: the shaft slides through that freely.
    slope = axis[:2] / axis[2] if back_mm > LEVER_MM else np.zeros(2)
    for first, point, across in ((0, tip, np.zeros(2)), (3, tip - back_mm * axis, slope)):
        planes = rows[first : first + 3]
        planes[:, 1:3], planes[:, 3], planes[:, 4:7] = _SIDES, -_SIDES @ across, point
        # The corners of the triangle are at the tolerance, its sides at half of it.
        planes[:, 0] = planes[:, 3] * point[2] - 0.5 * tolerance_mm
        planes[:, :4] /= np.linalg.norm(planes[:, 1:4], axis=1)[:, None]
    rows[6, 0], rows[6, 3], rows[6, 4:7] = -depth_mm, -1.0, tip
    return rows


def _placed(rows: FloatArray, pose: Transform) -> FloatArray:
    """``rows`` (k, 10) of a constraint at rest, moved by ``pose``."""
    moved = np.zeros_like(rows)
    moved[:, 1:4], moved[:, 4:7] = pose.rotate(rows[:, 1:4]), pose.apply(rows[:, 4:7])
    moved[:, 0] = rows[:, 0] + moved[:, 1:4] @ pose.translation_mm
    return moved
