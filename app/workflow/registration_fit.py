"""Fit of a guided registration: the dwells of the tool so far, and the registration from them.

The robot's tip and the tracked tip are the same point, so every place where the tool rests gives a
pair: no landmark has to be known. A pointer touches the robot's tip with its own. Means, fit and
checks are those of ``marginguard calibrate robot-base``.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from app.geometry import (
    FloatArray,
    InputError,
    Stamp,
    TrackedTransform,
    TrackingStatus,
    Transform,
)
from app.registration import (
    DwellSettings,
    RegistrationError,
    RegistrationResult,
    detect_dwells,
    register_points,
)
from app.runtime.tracked_tool import GUARDED_TOOL
from app.session import REFERENCE, mean_dwell_pose

SETTINGS = DwellSettings(min_turn_rad=0.0)
"""The tip at rest for 1 s; a tool on a robot need not rotate meanwhile."""
MIN_POINTS = 4
"""Points from which the fit has residuals that say something; 3 determine it."""

Interval = tuple[int, int]
"""First and last stamp in ns."""


@dataclass(frozen=True, slots=True, eq=False)
class RegistrationTask:
    """Samples (n) of the tool in the reference, and of the robot's link in its base.

    ``times_ns`` (n,), rotations (n, 3, 3), translations (n, 3) in mm. ``excluded``: intervals of
    dwells that an operator has removed. ``targets_mm`` (m, 3) in the reference are where accuracy
    is needed, None while the tumour is not tracked. Can be sent to another process.
    """

    run: int
    times_ns: Sequence[int]
    tool_rotations: FloatArray
    tool_translations_mm: FloatArray
    link_rotations: FloatArray
    link_translations_mm: FloatArray
    tool_from_tip: Transform
    base_frame: str
    tool_link: str
    excluded: tuple[Interval, ...]
    targets_mm: FloatArray | None
    tool: str = GUARDED_TOOL


@dataclass(frozen=True, slots=True)
class TouchedPoint:
    """A dwell of the tool. ``interval`` identifies it.

    ``residual_mm`` and ``leave_one_out_mm`` are None while there is no registration, and for a
    point that is not used because of ``problem``.
    """

    interval: Interval
    position_mm: tuple[float, float, float]
    residual_mm: float | None = None
    leave_one_out_mm: float | None = None
    problem: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class RegistrationFit:
    """Points so far, in order of time, and the registration; None with the cause in ``reason``."""

    run: int
    samples: int
    excluded: tuple[Interval, ...]
    points: tuple[TouchedPoint, ...]
    result: RegistrationResult | None
    reason: str
    advice: str

    @property
    def accepted(self) -> bool:
        """True if the registration may be used."""
        return self.result is not None and self.result.accepted


def fit_registration(task: RegistrationTask) -> RegistrationFit:
    """Detect the dwells of ``task`` and register; what determines nothing is a result, too."""
    points, pairs = _points(task)
    used = [number for number, pair in enumerate(pairs) if pair is not None]
    found = [pair for pair in pairs if pair is not None]
    result, reason = None, ""
    try:
        if len(found) < MIN_POINTS:
            reason = f"{len(found)} points; expected at least {MIN_POINTS}"
        else:
            result = register_points(
                np.array([fixed for fixed, _ in found]),
                np.array([moving for _, moving in found]),
                fixed_frame=REFERENCE,
                moving_frame=task.base_frame,
                targets_mm=task.targets_mm,
            )
            reason = result.reason
            for row, number in enumerate(used):
                left_out = float(result.leave_one_out_mm[row])
                points[number] = replace(
                    points[number],
                    residual_mm=float(result.residuals_mm[row]),
                    leave_one_out_mm=left_out if np.isfinite(left_out) else None,
                )
    except RegistrationError as error:
        reason = str(error)
    return RegistrationFit(
        run=task.run,
        samples=len(task.times_ns),
        excluded=task.excluded,
        points=tuple(points),
        result=result,
        reason=reason,
        advice=_advice(result, task.tool),
    )


def _points(
    task: RegistrationTask,
) -> tuple[list[TouchedPoint], list[tuple[FloatArray, FloatArray] | None]]:
    """The dwells, and for each the tip in the reference and in the base; None if it is not used."""
    times = np.array(task.times_ns, dtype=np.int64)
    kept = np.ones(len(times), dtype=bool)
    for first, last in task.excluded:
        kept &= (times < first) | (times > last)
    links = {
        index: Transform(
            task.base_frame,
            task.tool_link,
            task.link_rotations[index],
            task.link_translations_mm[index],
        )
        for index in np.flatnonzero(kept).tolist()
    }
    samples = [
        TrackedTransform(link, Stamp(int(times[index])), TrackingStatus.OK)
        for index, link in links.items()
    ]
    dwells = detect_dwells(samples, SETTINGS) if samples else ()
    points: list[TouchedPoint] = []
    pairs: list[tuple[FloatArray, FloatArray] | None] = []
    for dwell in dwells:
        inside = [i for i in links if dwell.start.ns <= times[i] <= dwell.end.ns]
        interval = dwell.start.ns, dwell.end.ns
        x, y, z = dwell.position_mm.tolist()
        try:
            mean = mean_dwell_pose(
                [
                    Transform(
                        REFERENCE,
                        task.tool_from_tip.target,
                        task.tool_rotations[i],
                        task.tool_translations_mm[i],
                    )
                    for i in inside
                ],
                [links[i] for i in inside],
                f"point {len(points) + 1}",
                task.tool_from_tip,
            )
        except InputError as error:
            points.append(TouchedPoint(interval, (x, y, z), problem=str(error)))
            pairs.append(None)
            continue
        tip = mean.reference_from_tool.apply(task.tool_from_tip.translation_mm)
        points.append(TouchedPoint(interval, (x, y, z)))
        pairs.append((tip, mean.base_from_link.translation_mm))
    return points, pairs


def _advice(result: RegistrationResult | None, tool: str) -> str:
    if result is None:
        tip = "the tip" if tool == GUARDED_TOOL else f"robot and {tool}, tip on tip,"
        return f"hold {tip} still for 1 s at each point, around the tumour and not in one plane"
    if result.accepted:
        return ""
    return "remove the point with the largest error and touch it again, or touch more points"
