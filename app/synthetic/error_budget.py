"""Effect of a case's errors on its margin: depths that breaches need, tolerances of a replay.

Closed forms from the errors that are put in; nothing here runs the software under test.
"""

from dataclasses import dataclass

import numpy as np

from app.geometry import FloatArray, InputError, Transform
from app.synthetic.case_options import CaseOptions

CROSSING_SPEED_MM_S = 45.0
"""Fast enough that jitter moves a detected crossing by a frame or two at most; below v_max."""

_SIGMAS = 3.0
_TIP_LEVER_MM = 70.0
"""From the tool's sensor to its tip."""
_TOOL_FROM_METAL_MM = 60.0
_SENSOR_FROM_METAL_MM = 90.0
"""The nearest that the sensors of tool and tumour come to the arm."""
_SHAFT_LEVER_MM = 15.0
"""From the tip to the part of the tool beside the tumour."""
_MAX_DEPTH_SHARE = 0.8
"""Limit as a share of the tumour's smallest radius: deeper, the tool leaves on the other side."""
_CLEAR_MM = 0.3
"""Depth of a breach beyond the bound of the error."""
_WHITE_LEFT = 0.15
"""Share of white noise that is left after the mean of a dwell of 1.2 s at 40 Hz."""


@dataclass(frozen=True, slots=True)
class Depths:
    """Depths of the three breaches, and the tool's least distance otherwise, in mm.

    ``deepest_mm`` bounds a breach; ``halt_mm`` is where an ideal fixture stops the tool.
    """

    deep_mm: float = 5.0
    brief_mm: float = 1.8
    shaft_mm: float = 2.8
    nearest_mm: float = 3.5
    deepest_mm: float = np.inf
    halt_mm: float = 1.0


@dataclass(frozen=True, slots=True)
class Tolerances:
    """Allowed differences between a replay and the truth, for ``expected.yaml``."""

    registration_mm: float
    registration_deg: float
    breach_ms: float
    depth_mm: float


def margin_bound_mm(options: CaseOptions, contour_mm: float, sensor_lever_mm: float) -> float:
    """Bound of the measured margin's error: three sigma, and the largest of the rest.

    ``contour_mm`` is the largest error of the contour, ``sensor_lever_mm`` the distance from the
    tumour's sensor to the far side of the tumour. The terms are independent, so their squares are
    added.
    """
    model, errors = options.tracker, options.errors
    jitter = model.white.position_rms_mm**2 + model.slow.position_rms_mm**2
    turn = model.white.angle_rms_rad**2 + model.slow.angle_rms_rad**2
    levers = sensor_lever_mm**2 + _TIP_LEVER_MM**2
    noise = (2.0 * jitter + turn * levers) / 3.0 + model.position_quantum_mm**2 / 6.0
    field = model.distortion
    near, far = field.share(_TOOL_FROM_METAL_MM), field.share(_SENSOR_FROM_METAL_MM)
    bent = near * (field.shift_mm + _TIP_LEVER_MM * field.turn_rad)
    bent += far * (field.shift_mm + sensor_lever_mm * field.turn_rad)
    fixed = (contour_mm, errors.tip_mm, _SHAFT_LEVER_MM * errors.tip_rad, errors.needle_mm, bent)
    return float(np.sqrt(_SIGMAS**2 * noise + sum(term**2 for term in fixed)))


def plan_depths(bound_mm: float, min_radius_mm: float) -> Depths:
    """Depths that every breach can be told apart with; raises `InputError` if none are.

    A breach is deeper than the bound of the error, and no deeper than 0.8 of the tumour's smallest
    radius; between breaches the tool stays farther away than the bound.
    """
    usual = Depths()
    limit_mm = _MAX_DEPTH_SHARE * min_radius_mm
    least_mm = bound_mm + _CLEAR_MM
    if least_mm > limit_mm:
        raise InputError(
            f"errors of tracker and case move the margin by up to {bound_mm:.2f} mm; expected "
            f"{limit_mm - _CLEAR_MM:.2f} mm or less for a tumour with a smallest radius of "
            f"{min_radius_mm:.1f} mm"
        )
    deep, brief, shaft = (
        max(min(depth, limit_mm), least_mm)
        for depth in (usual.deep_mm, usual.brief_mm, usual.shaft_mm)
    )
    nearest = max(usual.nearest_mm, bound_mm + 2.0)
    return Depths(deep, brief, shaft, nearest, limit_mm, usual.halt_mm + bound_mm)


def tolerances(
    options: CaseOptions,
    bound_mm: float,
    landmarks_mm: FloatArray,
    reference_from_base: Transform,
    crossing_speed_mm_s: float,
) -> Tolerances:
    """Allowed differences of a replay from the truth, from the errors that were put in.

    Times: a crossing is found when the margin is off by ``bound_mm``, and up to a period late;
    ``crossing_speed_mm_s`` is the smallest speed along the surface's normal.
    Registration: Fitzpatrick's formula for the target registration error at the base's origin,
    three times the standard deviation. ``landmarks_mm`` (n, 3) are in the base.
    """
    model = options.tracker
    period_ms = 1000.0 * model.period_s * (1.0 + (model.repeated > 0.0) + (model.skipped > 0.0))
    time_ms = 1000.0 * (bound_mm / crossing_speed_mm_s + _SIGMAS * model.stamp_sd_s)
    fle = _landmark_error_mm(options, reference_from_base, landmarks_mm)
    centred = landmarks_mm - landmarks_mm.mean(axis=0)
    _, axes = np.linalg.eigh(centred.T @ centred)
    on_axes = centred @ axes
    origin = -landmarks_mm.mean(axis=0) @ axes
    shares = []
    for k in range(3):
        others = [i for i in range(3) if i != k]
        squares = float((on_axes[:, others] ** 2).sum(axis=1).mean())
        shares.append(float((origin[others] ** 2).sum()) / squares)
    count = len(landmarks_mm)
    tre = fle * np.sqrt((1.0 + sum(shares) / 3.0) / count)
    angle = fle / np.sqrt(3.0 * count) * np.sqrt(3.0 / float((centred**2).sum(axis=1).mean()) * 1.5)
    return Tolerances(
        max(1.0, _round_up(_SIGMAS * float(tre))),
        max(0.5, _round_up(_SIGMAS * float(np.degrees(angle)))),
        max(40.0, float(np.ceil(time_ms + 0.75 * period_ms))),
        max(1.25, _round_up(bound_mm)),
    )


def _landmark_error_mm(
    options: CaseOptions,
    reference_from_base: Transform,
    landmarks_mm: FloatArray,
) -> float:
    """RMS error of a landmark in 3-D, after the mean over a dwell: only slow errors remain."""
    model, errors = options.tracker, options.errors
    lever = float(np.linalg.norm(reference_from_base.apply(landmarks_mm), axis=1).mean())
    robot_mm = float(np.linalg.norm(landmarks_mm, axis=1).mean())
    shift = model.slow.position_rms_mm**2 + (_WHITE_LEFT * model.white.position_rms_mm) ** 2
    turn = model.slow.angle_rms_rad**2 + (_WHITE_LEFT * model.white.angle_rms_rad) ** 2
    field = model.distortion
    terms = (
        np.sqrt(2.0 * shift + turn * (lever**2 + _TIP_LEVER_MM**2) * 2.0 / 3.0),
        errors.tip_mm,
        field.share(_TOOL_FROM_METAL_MM) * (field.shift_mm + _TIP_LEVER_MM * field.turn_rad),
        field.share(_SENSOR_FROM_METAL_MM) * (field.shift_mm + lever * field.turn_rad),
        errors.encoder_offset_rad * robot_mm,
    )
    return float(np.sqrt(sum(term**2 for term in terms)))


def _round_up(value: float) -> float:
    return float(np.ceil(20.0 * value) / 20.0)
