"""A script for the tool: rests, moves, strokes and plunges, written down as waypoints."""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.optimize import brentq

from app.geometry import FloatArray, Transform
from app.synthetic.motion import Path, Waypoint

_STILL = np.zeros(3)

PLUNGE_FROM_MM = 7.0
"""How far from the tumour a plunge starts and ends."""


class Script:
    """Waypoints one after the other; the tool rests where each of the steps ends.

    ``distance_mm`` gives the tool's signed distance to the tumour at a pose.
    """

    def __init__(self, start: Transform, distance_mm: Callable[[Transform], float]) -> None:
        self._waypoints = [Waypoint(0.0, start, _STILL)]
        self._distance_mm = distance_mm

    @property
    def now_s(self) -> float:
        """When the script, as written so far, ends."""
        return self._waypoints[-1].time_s

    @property
    def path(self) -> Path:
        """The motion that was written down."""
        return Path(self._waypoints)

    def rest(self, duration_s: float) -> tuple[float, float]:
        """Hold still; returns from when to when."""
        start_s = self.now_s
        self._add(duration_s, self._waypoints[-1].pose)
        return start_s, self.now_s

    def move_to(self, pose: Transform, duration_s: float) -> None:
        """Go straight to ``pose`` and stop there."""
        self._add(duration_s, pose)

    def stroke(self, poses: Sequence[Transform], duration_s: float) -> None:
        """Go smoothly through ``poses`` (the first is where the tool goes first), stop at the last.

        Equal times between poses; the velocity at each is that between its neighbours
        (Catmull-Rom).
        """
        step_s = duration_s / len(poses)
        line = [self._waypoints[-1].pose, *poses]
        for before, here, after in zip(line, line[1:], [*line[2:], None], strict=False):
            velocity = _STILL
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
        """Push the tool into the tumour along ``direction`` (unit, (3,)), hold, pull it back.

        ``touching`` is a pose near the surface; the tool is shifted along ``direction`` from it to
        `PLUNGE_FROM_MM` before the tumour, to its surface, and to ``depth_mm`` inside. It crosses
        the surface at ``speed_mm_s`` both ways.
        """

        def shifted(along_mm: float) -> Transform:
            return Transform(
                touching.target,
                touching.source,
                touching.rotation,
                touching.translation_mm + along_mm * direction,
            )

        def where(distance_mm: float) -> float:
            def miss(along_mm: float) -> float:
                return self._distance_mm(shifted(along_mm)) - distance_mm

            return float(brentq(miss, -20.0, 12.0, xtol=1e-6))

        before, surface, deepest = where(PLUNGE_FROM_MM), where(0.0), where(-depth_mm)
        # Between rest and a speed the mean is half of it: acceleration is 0 at both ends.
        approach_s = 2.0 * (surface - before) / speed_mm_s
        brake_s = 2.0 * (deepest - surface) / speed_mm_s
        velocity = speed_mm_s * direction
        self._add(1.5, shifted(before))
        self._add(approach_s, shifted(surface), velocity)
        self._add(brake_s, shifted(deepest))
        self._add(hold_s, shifted(deepest))
        self._add(brake_s, shifted(surface), -velocity)
        self._add(approach_s, shifted(before))

    def _add(self, duration_s: float, pose: Transform, velocity: FloatArray = _STILL) -> None:
        self._waypoints.append(Waypoint(self.now_s + duration_s, pose, velocity))
