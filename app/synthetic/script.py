"""Builds the waypoints of a tool from rests, moves, strokes and plunges."""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.optimize import brentq

from app.geometry import FloatArray, InputError, Transform
from app.synthetic.motion import Path, Waypoint

_AT_REST = np.zeros(3)

PLUNGE_FROM_MM = 7.0
"""Distance from the tumour at which a plunge starts and ends."""

_RANGE_MM = (-20.0, 12.0)
_SCAN_MM = 0.5
"""Range and step in which the surface is searched, from the pose near it."""


class Script:
    """A growing list of waypoints; the tool is at rest at the end of each step.

    ``distance_mm`` returns the tool's signed distance to the tumour at a pose.
    """

    def __init__(self, start: Transform, distance_mm: Callable[[Transform], float]) -> None:
        self._waypoints = [Waypoint(0.0, start, _AT_REST)]
        self._distance_mm = distance_mm

    @property
    def end_s(self) -> float:
        """Time of the last waypoint."""
        return self._waypoints[-1].time_s

    @property
    def path(self) -> Path:
        """The motion through all waypoints."""
        return Path(self._waypoints)

    def rest(self, duration_s: float) -> tuple[float, float]:
        """Hold the pose; returns start and end."""
        start_s = self.end_s
        self._add(duration_s, self._waypoints[-1].pose)
        return start_s, self.end_s

    def move_to(self, pose: Transform, duration_s: float) -> None:
        """Move straight to ``pose`` and stop there."""
        self._add(duration_s, pose)

    def stroke(self, poses: Sequence[Transform], duration_s: float) -> None:
        """Move smoothly through ``poses``, one after the other, and stop at the last.

        Times between poses are equal. The velocity at each is the mean one between its neighbours
        (Catmull-Rom).
        """
        step_s = duration_s / len(poses)
        line = [self._waypoints[-1].pose, *poses]
        for before, here, after in zip(line, line[1:], [*line[2:], None], strict=False):
            velocity = _AT_REST
            if after is not None:
                velocity = (after.translation_mm - before.translation_mm) / (2.0 * step_s)
            self._add(step_s, here, velocity)

    def plunge(
        self,
        touching: Transform,
        direction: FloatArray,
        *,
        depth_mm: float,
        hold_s: float,
        speed_mm_s: float,
    ) -> None:
        """Move the tool into the tumour along ``direction`` (unit, (3,)), hold, move it back.

        ``touching`` is a pose near the surface; the tool is shifted along ``direction`` from it to
        `PLUNGE_FROM_MM` before the tumour, to its surface, and to ``depth_mm`` inside. It crosses
        the surface at ``speed_mm_s`` in both directions.
        """

        def shifted(along_mm: float) -> Transform:
            return _shifted(touching, direction, along_mm)

        before, surface, deepest = (
            self._offset_at(touching, direction, distance_mm)
            for distance_mm in (PLUNGE_FROM_MM, 0.0, -depth_mm)
        )
        # The mean speed from rest is half the final one: acceleration is 0 at both ends.
        approach_s = 2.0 * (surface - before) / speed_mm_s
        brake_s = 2.0 * (deepest - surface) / speed_mm_s
        velocity = speed_mm_s * direction
        self._add(1.5, shifted(before))
        self._add(approach_s, shifted(surface), velocity)
        self._add(brake_s, shifted(deepest))
        self._add(hold_s, shifted(deepest))
        self._add(brake_s, shifted(surface), -velocity)
        self._add(approach_s, shifted(before))

    def halt(
        self,
        touching: Transform,
        direction: FloatArray,
        *,
        distance_mm: float,
        hold_s: float,
        speed_mm_s: float,
    ) -> None:
        """Move the tool as for a `plunge`, but only to ``distance_mm`` before the tumour.

        It rests there for ``hold_s`` and returns. The mean speed is half of ``speed_mm_s``.
        """
        before, nearest = (
            self._offset_at(touching, direction, mm)
            for mm in (max(PLUNGE_FROM_MM, distance_mm + 2.0), distance_mm)
        )
        approach_s = 2.0 * (nearest - before) / speed_mm_s
        self._add(1.5, _shifted(touching, direction, before))
        self._add(approach_s, _shifted(touching, direction, nearest))
        self._add(hold_s, _shifted(touching, direction, nearest))
        self._add(approach_s, _shifted(touching, direction, before))

    def reaches(self, touching: Transform, direction: FloatArray, depth_mm: float) -> bool:
        """True if a `plunge` with these values can be as deep."""

        def residual(along_mm: float) -> float:
            return self._distance_mm(_shifted(touching, direction, along_mm)) + depth_mm

        return _bracket(residual) is not None

    def _offset_at(self, touching: Transform, direction: FloatArray, distance_mm: float) -> float:
        """The shift along ``direction`` at which the tool has this distance to the tumour."""

        def residual(along_mm: float) -> float:
            return self._distance_mm(_shifted(touching, direction, along_mm)) - distance_mm

        bracket = _bracket(residual)
        if bracket is None:
            raise InputError(
                f"the tool cannot come to a distance of {distance_mm:.2f} mm; expected a "
                "larger tumour or smaller errors of the case"
            )
        return float(brentq(residual, *bracket, xtol=1e-6))

    def _add(self, duration_s: float, pose: Transform, velocity: FloatArray = _AT_REST) -> None:
        self._waypoints.append(Waypoint(self.end_s + duration_s, pose, velocity))


def _shifted(pose: Transform, direction: FloatArray, along_mm: float) -> Transform:
    return Transform(
        pose.target, pose.source, pose.rotation, pose.translation_mm + along_mm * direction
    )


def _bracket(residual: Callable[[float], float]) -> tuple[float, float] | None:
    """Where a plunge crosses a distance for the first time: a positive and a negative residual.

    At the end of the range the tool may have passed through a small tumour, where its surface is
    nearer to the tumour's than its tip was on the way. None if it is never that deep.
    """
    start, end = _RANGE_MM
    if residual(end) < 0.0:
        return start, end
    for along_mm in np.arange(start + _SCAN_MM, end, _SCAN_MM).tolist():
        if residual(along_mm) < 0.0:
            return along_mm - _SCAN_MM, along_mm
    return None
