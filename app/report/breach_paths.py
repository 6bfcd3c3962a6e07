"""The deepest point of each breach on the interpolated path, found after a replay.

The rows of a report are frames. A tool that moves fast is deeper between two of them than in any.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from app.analysis.breaches import Breach
from app.geometry import Freshness, FreshnessLimits, freshness_of
from app.session import PathDepth, PathPoint, deepest_on_path

if TYPE_CHECKING:
    from app.session import ProximityModel, StepResult

TOLERANCE_MM = 0.02
MAX_EVALUATIONS = 1000
"""Accuracy of the depth of a breach, and the limit of the work for one breach."""


@dataclass(slots=True)
class BreachPaths:
    """The measured poses of a replay that are inside the tumour, and those before and after."""

    _points: dict[int, tuple[PathPoint, ...]] = field(default_factory=dict)
    _before: dict[int, int] = field(default_factory=dict)
    _after: dict[int, int] = field(default_factory=dict)
    _last: tuple[int, PathPoint] | None = None
    _last_inside: bool = False

    def add(self, index: int, step: "StepResult", *, inside: bool) -> None:
        """Add the step of row ``index``; ``inside`` as in `ReportRow`."""
        pose, proximity = step.tumor_from_tip, step.decision.proximity
        if pose is None or proximity is None or not proximity.is_finite:
            return
        if step.between_frames is None:
            points: tuple[PathPoint, ...] = (PathPoint(step.frame.stamp, pose, proximity),)
        else:
            points = (step.between_frames.deepest, step.between_frames.end)
        if self._last is not None and (inside or self._last_inside):
            last_index, last_point = self._last
            self._points.setdefault(last_index, (last_point,))
            self._before[index], self._after[last_index] = last_index, index
        if inside or self._last_inside:
            self._points[index] = points
        self._last, self._last_inside = (index, points[-1]), inside

    def points_of(self, breach: Breach, stale_after_ns: int) -> Sequence[PathPoint]:
        """The path of ``breach``, from the last pose before it to the first one after it.

        A pose that is more than ``stale_after_ns`` away is left out: where the tool was meanwhile
        is unknown.
        """
        indices = [index for index in self._points if breach.first <= index <= breach.last]
        points = [point for index in sorted(indices) for point in self._points[index]]
        limits = FreshnessLimits(stale_after_ns)
        before, after = self._before.get(breach.first), self._after.get(breach.last)
        if before is not None:
            point = self._points[before][-1]
            if freshness_of(point.stamp.ns, points[0].stamp.ns, limits) is Freshness.VALID:
                points.insert(0, point)
        if after is not None:
            point = self._points[after][0]
            if freshness_of(points[-1].stamp.ns, point.stamp.ns, limits) is Freshness.VALID:
                points.append(point)
        return points


def breach_depths(
    paths: BreachPaths, breaches: Sequence[Breach], model: "ProximityModel", stale_after_ns: int
) -> Mapping[int, PathDepth]:
    """The `PathDepth` of each breach, by the index of its first row."""
    return {
        breach.first: deepest_on_path(
            points,
            model.evaluate,
            radius_mm=model.radius_mm,
            tolerance_mm=TOLERANCE_MM,
            max_evaluations=MAX_EVALUATIONS,
        )
        for breach in breaches
        if (points := paths.points_of(breach, stale_after_ns))
    }
