"""Spin calibration: which way the shaft of a tracked tool points, from poses that turn about it.

The shaft ``a`` in the tool frame is the direction that all poses map to one direction in the
reference frame. ``sum |R_i a - b|^2`` is least, over ``a`` and the unknown ``b``, for the leading
right singular vector of ``sum R_i``; for pairs of poses that is the smallest eigenvector of
``sum (R_ij - 1)^T (R_ij - 1)``.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from app.geometry import FloatArray, Transform
from app.registration.consensus import agreeing
from app.registration.errors import DegenerateMotionError, ShapeError
from app.registration.inputs import as_point
from app.registration.poses import PoseStack
from app.registration.uncertainty.result import checked_covariance, read_only

MIN_POSES = 10

MIN_TURN_RAD = math.radians(15.0)

NOMINAL_SIGMA_RAD = math.radians(0.3)
LEAST_SIGMA_RAD = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class SpinResult:
    """``shaft`` (3,), a unit vector in the tool frame, from the sensor's side to the tip's.

    ``covariance`` (3, 3)
        Of the shaft's direction in rad2, flat along it.
    ``residuals_rad`` (n,)
        Angle of the shaft from its mean direction in each pose, dropped poses included.
    ``turn_rad``
        Largest turn between two poses.
    """

    tool_frame: str
    shaft: FloatArray
    covariance: FloatArray
    residuals_rad: FloatArray
    turn_rad: float
    outliers: tuple[int, ...]
    accepted: bool
    reason: str

    def __post_init__(self) -> None:
        for name in ("shaft", "residuals_rad"):
            object.__setattr__(self, name, read_only(getattr(self, name)))
        object.__setattr__(self, "covariance", checked_covariance(self.covariance, 3))

    @property
    def sigma_rad(self) -> float:
        """Root mean square angle between the shaft and the truth that is to be expected."""
        return math.sqrt(float(np.trace(self.covariance)))


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    shaft: FloatArray
    mean_direction: FloatArray
    sigma_rad: float


def calibrate_spin(
    reference_from_tool: Sequence[Transform],
    *,
    tip_mm: ArrayLike,
    max_sigma_rad: float = math.radians(0.5),
) -> SpinResult:
    """The shaft of a tool from n >= 10 poses that turn about it.

    ``tip_mm`` (3,) in the tool frame, from a pivot, tells which of the two ways along the axis is
    the shaft's. Not accepted when the expected error of the direction is over ``max_sigma_rad``.
    Raises `TooFewError`, `FrameError`, `DegenerateMotionError` (one pose repeated, hardly any
    turn, a tip beside the axis) or `NoConsensusError` (no majority turns about one axis).
    """
    if not (math.isfinite(max_sigma_rad) and max_sigma_rad > 0.0):
        raise ShapeError(f"max_sigma_rad is {max_sigma_rad}: above 0 wanted")
    tip = as_point(tip_mm, "tip_mm")
    poses = PoseStack.of(reference_from_tool, "a spin", least=MIN_POSES)
    _largest_turn(poses)

    def start(mask: NDArray[np.bool_]) -> _Fit:
        return _axis(poses.rotations[mask], NOMINAL_SIGMA_RAD)

    def refine(mask: NDArray[np.bool_], fit: _Fit) -> _Fit:
        again = _axis(poses.rotations[mask], fit.sigma_rad)
        angles = _angles(again, poses.rotations[mask])
        # Two numbers a pose, less two for each of the two directions that were fitted.
        freedom = 2 * int(mask.sum()) - 4
        sigma = math.sqrt(float(np.sum(angles**2)) / freedom)
        return _Fit(again.shaft, again.mean_direction, max(sigma, LEAST_SIGMA_RAD))

    good, fit = agreeing(
        len(reference_from_tool),
        "poses of a spin",
        draw=4,
        noise_known=False,
        start=start,
        refine=refine,
        linearise=lambda fit: _linearised(fit, poses.rotations),
    )
    turn = _largest_turn(poses.of_poses(good))
    toward = float(fit.shaft @ tip)
    if abs(toward) <= 0.1 * float(np.linalg.norm(tip)):
        raise DegenerateMotionError(
            f"the axis of the spin is across the line to the tip {tip.tolist()}: "
            "the tool was not turned about its shaft"
        )
    covariance = _covariance(fit, poses.rotations[good])
    sigma = math.sqrt(float(np.trace(covariance)))
    what = f"sigma of the shaft is {math.degrees(sigma):.3g} degrees"
    accepted = sigma <= max_sigma_rad
    return SpinResult(
        tool_frame=poses.source,
        shaft=fit.shaft * np.sign(toward),
        covariance=covariance,
        residuals_rad=_angles(fit, poses.rotations),
        turn_rad=turn,
        outliers=tuple(np.flatnonzero(~good).tolist()),
        accepted=accepted,
        reason=f"{what} from {int(good.sum())} of {len(good)} poses"
        if accepted
        else f"{what}, {math.degrees(max_sigma_rad):.3g} degrees allowed",
    )


def _largest_turn(poses: PoseStack) -> float:
    largest = float(np.linalg.norm(poses.relative_turns(), axis=1).max())
    if largest < MIN_TURN_RAD:
        raise DegenerateMotionError(
            f"the poses of a spin turn by {math.degrees(largest):.3g} degrees at most: "
            f"{math.degrees(MIN_TURN_RAD):g} wanted"
        )
    return largest


def _axis(rotations: FloatArray, sigma_rad: float) -> _Fit:
    left, _, right = np.linalg.svd(rotations.sum(axis=0))
    return _Fit(right[0], left[:, 0], sigma_rad)


def _angles(fit: _Fit, rotations: FloatArray) -> FloatArray:
    directions = rotations @ fit.shaft
    cross = np.linalg.norm(np.cross(directions, fit.mean_direction), axis=1)
    return np.asarray(np.arctan2(cross, directions @ fit.mean_direction))


def _linearised(fit: _Fit, rotations: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Misfits (n, 2) of the shaft across its mean direction, as long as the angle between them.

    With how they answer (n, 2, 4) to turns of the shaft and of the mean direction; both in sigmas.
    """
    beside_mean, beside_shaft = _across(fit.mean_direction), _across(fit.shaft)
    sideways = rotations @ fit.shaft @ beside_mean
    length = np.maximum(np.linalg.norm(sideways, axis=1), 1e-300)
    misfits = sideways * (_angles(fit, rotations) / length)[:, None]
    turned = beside_mean.T @ rotations @ beside_shaft
    still = np.broadcast_to(-np.eye(2), turned.shape)
    return misfits / fit.sigma_rad, np.concatenate([turned, still], axis=2) / fit.sigma_rad


def _across(direction: FloatArray) -> FloatArray:
    """Two unit vectors across a direction and each other, as columns (3, 2)."""
    return np.asarray(np.linalg.svd(direction[None])[2][1:].T)


def _covariance(fit: _Fit, rotations: FloatArray) -> FloatArray:
    """``sigma^2`` over the information ``n - M^T M / n`` across the shaft, M the sum of the poses.

    First order: a pose whose noise turns the shaft by ``e_i`` pulls the estimate by ``R_i^T e_i``,
    less what the unknown mean direction takes up.
    """
    count, total = len(rotations), rotations.sum(axis=0)
    information = count * np.eye(3) - total.T @ total / count
    across = _across(fit.shaft)
    inverse = np.linalg.inv(across.T @ information @ across)
    return np.asarray(fit.sigma_rad**2 * across @ inverse @ across.T)
