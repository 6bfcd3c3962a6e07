"""Fit of a guided calibration: what its poses determine so far, and what is missing.

The checks are those of ``marginguard calibrate``: the same functions select and fit the poses.
"""

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import scipy  # loads `scipy.spatial` lazily

from app.geometry import FloatArray, Transform
from app.registration import (
    ConvergenceError,
    NoConsensusError,
    RegistrationError,
    calibrate_pivot,
    calibrate_spin,
    select_pivot_poses,
    select_poses,
    tip_transform,
)

SECTORS = 8
MIN_TILT_RAD = math.radians(10.0)
"""Tilt from the mean direction above which a pose of a pivot covers its sector."""
_MAX_POINTS = 240


@dataclass(frozen=True, slots=True, eq=False)
class Coverage:
    """Directions of the tool as points in a plane.

    ``points_deg`` (n, 2)
        Of a pivot: tilt of the shaft from its mean direction, in degrees along two axes at rest.
        Of a spin: the rotation about the shaft, as points of a circle with radius 30.
    ``sectors``
        True for each of 8 sectors, counted from +x towards +y, in which there is a pose.
    ``spread_rad``
        Largest angle between two directions (pivot) or two rotations (spin).
    """

    points_deg: FloatArray
    sectors: tuple[bool, ...]
    spread_rad: float


def pivot_coverage(rotations: FloatArray, shaft: FloatArray) -> Coverage:
    """Coverage by tools rotated by ``rotations`` (n, 3, 3), with the unit vector ``shaft`` (3,)."""
    directions = _thinned(rotations) @ shaft
    mean = directions.mean(axis=0)
    mean /= max(float(np.linalg.norm(mean)), 1e-9)
    x, y = _axes_across(mean)
    across = np.stack([directions @ x, directions @ y], axis=1)
    tilts = np.arccos(np.clip(directions @ mean, -1.0, 1.0))
    lengths = np.maximum(np.linalg.norm(across, axis=1), 1e-9)
    points = across / lengths[:, None] * np.degrees(tilts)[:, None]
    spread = math.acos(float(np.clip((directions @ directions.T).min(), -1.0, 1.0)))
    return Coverage(points, _sectors(points[tilts >= MIN_TILT_RAD]), spread)


def spin_coverage(rotations: FloatArray, shaft: FloatArray) -> Coverage:
    """Coverage of the rotations (n, 3, 3) about the unit vector ``shaft`` (3,) of the tool."""
    used = _thinned(rotations)
    x, y = _axes_across(shaft)
    moved = used[0].T @ used @ x
    angles = np.arctan2(moved @ y, moved @ x)
    points = 30.0 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    turned = (np.einsum("aij,bij->ab", used, used).min() - 1.0) / 2.0
    return Coverage(points, _sectors(points), math.acos(float(np.clip(turned, -1.0, 1.0))))


def _thinned(rotations: FloatArray) -> FloatArray:
    chosen = np.linspace(0, len(rotations) - 1, min(len(rotations), _MAX_POINTS))
    return np.asarray(rotations[np.unique(chosen.round().astype(int))])


def _axes_across(direction: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors (3,) across ``direction``, which change little when it changes little."""
    away = np.eye(3)[int(np.argmin(np.abs(direction)))]
    x = np.cross(away, direction)
    x /= np.linalg.norm(x)
    return x, np.asarray(np.cross(direction, x))


def _sectors(points: FloatArray) -> tuple[bool, ...]:
    angles = np.arctan2(points[:, 1], points[:, 0]) % (2.0 * math.pi)
    covered = set((angles / (2.0 * math.pi) * SECTORS).astype(int) % SECTORS)
    return tuple(number in covered for number in range(SECTORS))


NO_TIP_MM = 1e-3
"""A tip this close to the sensor's origin has never been calibrated."""


class CalibrationKind(StrEnum):
    """Part of a tool that is calibrated."""

    PIVOT = "pivot"
    """The tip, of a tool that rotates about it."""
    SPIN = "spin"
    """The axis, of a tool that rotates about its shaft."""


ADVICE = {
    CalibrationKind.PIVOT: (
        "keep the tip in its divot, and tilt the tool slowly to all sides, in a cone of 60 degrees"
    ),
    CalibrationKind.SPIN: "keep the shaft where it is, and rotate the tool about it",
}
_SLIPPED = {
    CalibrationKind.PIVOT: "the tip has moved: hold it firmly in the divot, and begin again",
    CalibrationKind.SPIN: "the shaft has tilted: hold it in a guide, and begin again",
}
_MORE = {
    CalibrationKind.PIVOT: "continue, in the directions that are not covered",
    CalibrationKind.SPIN: "continue, over a larger angle",
}


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationTask:
    """Poses to be fitted: rotations (n, 3, 3) and translations (n, 3) in mm of the tool.

    ``run`` and ``reference`` identify the recording and the frame of the poses. ``tool_from_tip``
    is the tip in use. Holds plain values and can be sent to another process.
    """

    kind: CalibrationKind
    run: int
    reference: str
    rotations: FloatArray
    translations_mm: FloatArray
    tool_from_tip: Transform


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationFit:
    """Result of the poses so far.

    ``tool_from_tip`` is None while they determine none; ``reason`` then says why. ``accepted`` and
    ``reason`` are otherwise those of the calibration, ``advice`` says what to do next. ``samples``
    poses were recorded, ``used`` of them fitted, ``outliers`` of these dropped. ``rms`` is that of
    the residuals: in mm (pivot) or degrees (spin). ``sigma_mm``: standard deviation of the tip in
    its worst direction; None for a spin, which leaves the tip where it is. ``sigma_rad``: expected
    error of the axis of a spin. ``shift_mm``, ``turn_rad``: difference from the tip in use.
    """

    run: int
    samples: int
    coverage: Coverage
    accepted: bool
    reason: str
    advice: str
    tool_from_tip: Transform | None = None
    used: int = 0
    outliers: int = 0
    rms: float | None = None
    sigma_mm: float | None = None
    sigma_rad: float | None = None
    shift_mm: float = 0.0
    turn_rad: float = 0.0


def fit_calibration(task: CalibrationTask) -> CalibrationFit:
    """Fit the poses of ``task``; poses that determine nothing are a result with the cause."""
    poses = [
        Transform(task.reference, task.tool_from_tip.target, rotation, translation)
        for rotation, translation in zip(task.rotations, task.translations_mm, strict=True)
    ]
    fit = _fit_pivot if task.kind is CalibrationKind.PIVOT else _fit_spin
    try:
        return fit(task, poses)
    except (NoConsensusError, ConvergenceError) as error:
        return _undetermined(task, error, _SLIPPED[task.kind])
    except RegistrationError as error:
        return _undetermined(task, error, ADVICE[task.kind])


def _fit_pivot(task: CalibrationTask, poses: list[Transform]) -> CalibrationFit:
    selected = select_pivot_poses(poses)
    pivot = calibrate_pivot([poses[index] for index in selected])
    known = task.tool_from_tip
    found = _pivot_tip(known, pivot.tip_mm)
    return CalibrationFit(
        run=task.run,
        samples=len(poses),
        coverage=pivot_coverage(task.rotations, _unit(pivot.tip_mm)),
        accepted=pivot.accepted,
        reason=pivot.reason,
        advice="" if pivot.accepted else _MORE[task.kind],
        tool_from_tip=found,
        used=len(selected),
        outliers=len(pivot.outliers),
        rms=pivot.rms_mm,
        sigma_mm=math.sqrt(float(np.linalg.eigvalsh(pivot.covariance[:3, :3]).max())),
        shift_mm=known.distance_mm_to(found),
        turn_rad=known.angle_to(found),
    )


def _fit_spin(task: CalibrationTask, poses: list[Transform]) -> CalibrationFit:
    known = task.tool_from_tip
    # By angle only: a sensor close to the shaft hardly moves during a spin.
    selected = select_poses(poses, min_distance_mm=0.0)
    spin = calibrate_spin([poses[index] for index in selected], tip_mm=known.translation_mm)
    found = _spun_tip(known, spin.shaft)
    angles = np.degrees(np.delete(spin.residuals_rad, spin.outliers))
    return CalibrationFit(
        run=task.run,
        samples=len(poses),
        coverage=spin_coverage(task.rotations, spin.shaft),
        accepted=spin.accepted,
        reason=spin.reason,
        advice="" if spin.accepted else _MORE[task.kind],
        tool_from_tip=found,
        used=len(selected),
        outliers=len(spin.outliers),
        rms=float(np.sqrt(np.mean(angles**2))),
        sigma_rad=spin.sigma_rad,
        turn_rad=known.angle_to(found),
    )


def _pivot_tip(known: Transform, tip_mm: FloatArray) -> Transform:
    """The tip at ``tip_mm`` (3,) with the axes in use: a pivot says nothing about the rotation.

    A tool that was never calibrated has no axes yet: its +z is the line from sensor to tip.
    """
    if float(np.abs(known.translation_mm).max()) < NO_TIP_MM:
        return tip_transform(tip_mm, tip_mm, tool_frame=known.target, tip_frame=known.source)
    return Transform(known.target, known.source, known.rotation, tip_mm)


def _spun_tip(known: Transform, shaft: FloatArray) -> Transform:
    """The tip in use, turned by the smallest rotation that brings its +z to ``shaft`` (3,)."""
    z = known.rotation[:, 2]
    axis = np.cross(z, shaft)
    sine, cosine = float(np.linalg.norm(axis)), float(z @ shaft)
    if sine < 1e-9 and cosine > 0.0:
        return Transform(known.target, known.source, known.rotation, known.translation_mm)
    if sine < 1e-9:  # opposite directions: any axis across the shaft
        axis, sine = np.cross(z, np.eye(3)[int(np.argmin(np.abs(z)))]), 0.0
    vector = axis / np.linalg.norm(axis) * math.atan2(sine, cosine)
    turn = scipy.spatial.transform.Rotation.from_rotvec(vector).as_matrix()
    return Transform(known.target, known.source, turn @ known.rotation, known.translation_mm)


def _undetermined(task: CalibrationTask, error: RegistrationError, advice: str) -> CalibrationFit:
    known = task.tool_from_tip
    if task.kind is CalibrationKind.PIVOT:
        length_mm = float(np.linalg.norm(known.translation_mm))
        shaft = known.rotation[:, 2] if length_mm < NO_TIP_MM else known.translation_mm / length_mm
        coverage = pivot_coverage(task.rotations, shaft)
    else:
        coverage = spin_coverage(task.rotations, known.rotation[:, 2])
    return CalibrationFit(
        run=task.run,
        samples=len(task.rotations),
        coverage=coverage,
        accepted=False,
        reason=str(error),
        advice=advice,
    )


def _unit(vector: FloatArray) -> FloatArray:
    return vector / max(float(np.linalg.norm(vector)), 1e-9)
