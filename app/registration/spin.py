"""Spin calibration: the shaft direction of a tracked tool from poses that rotate about it.

All poses map the shaft ``a`` in the tool frame to one direction ``b`` in the reference frame.
``sum |R_i a - b|^2`` is minimal over ``a`` and ``b`` for the leading right singular vector of
``sum R_i``. Over all pairs of poses that equals the smallest eigenvector of
``sum (R_ij - 1)^T (R_ij - 1)`` with ``R_ij = R_i^T R_j``.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from app.geometry import FloatArray, Transform
from app.registration.consensus import find_consensus
from app.registration.input_checks import (
    DegenerateMotionError,
    ShapeError,
    as_point,
    check_positive,
)
from app.registration.pose_stack import PoseStack, fit_covariance
from app.registration.registration_result import checked_covariance, read_only

MIN_POSES = 10

NOMINAL_SIGMA_RAD = math.radians(0.3)
MIN_SIGMA_RAD = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class SpinResult:
    """The unit vector ``shaft`` (3,) in the tool frame, pointing to the side of the tip.

    ``covariance`` (3, 3)
        Of the shaft's direction, in rad2; singular along the shaft. For correlated errors, too:
        see `app.registration.pose_stack`.
    ``residuals_rad`` (n,)
        Angle of the shaft from its mean direction in each pose, outliers included.
    ``turn_rad``
        Largest rotation between two poses.
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
        """Expected root mean square angle between the shaft and its true direction."""
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
    """Compute the shaft of a tool from n >= 10 poses that rotate about it.

    ``tip_mm`` (3,) in the tool frame, from a pivot calibration, determines the sign of the axis.
    Not accepted if the expected error of the direction is above ``max_sigma_rad``. Raises
    `TooFewError`, `FrameError`, `DegenerateMotionError` (one pose repeated, too little rotation,
    axis across the line to the tip) or `NoConsensusError` (no majority rotates about one axis).
    """
    check_positive(max_sigma_rad, "max_sigma_rad")
    tip = as_point(tip_mm, "tip_mm")
    poses = PoseStack.from_poses(reference_from_tool, "a spin", min_count=MIN_POSES)
    poses.relative_rotations("a spin")

    def initialise(mask: NDArray[np.bool_]) -> _Fit:
        return _fit_axis(poses.rotations[mask], NOMINAL_SIGMA_RAD)

    def refine(mask: NDArray[np.bool_], fit: _Fit) -> _Fit:
        refined = _fit_axis(poses.rotations[mask], fit.sigma_rad)
        angles = _angles(refined, poses.rotations[mask])
        # Two residuals per pose, minus two parameters for each of the two fitted directions.
        freedom = 2 * int(mask.sum()) - 4
        sigma = math.sqrt(float(np.sum(angles**2)) / freedom)
        return _Fit(refined.shaft, refined.mean_direction, max(sigma, MIN_SIGMA_RAD))

    inliers, fit = find_consensus(
        len(reference_from_tool),
        "poses of a spin",
        sample_size=4,
        noise_known=False,
        initialise=initialise,
        refine=refine,
        linearise=lambda fit: _linearise(fit, poses.rotations),
    )
    turns = np.linalg.norm(poses.select(inliers).relative_rotations("a spin"), axis=1)
    along_tip = float(fit.shaft @ tip)
    if abs(along_tip) <= 0.1 * float(np.linalg.norm(tip)):
        raise DegenerateMotionError(
            f"the axis of the spin is across the line to the tip {tip.tolist()}; "
            "expected a rotation of the tool about its shaft"
        )
    by_axes = fit_covariance(*_linearise(fit, poses.rotations[inliers]), np.flatnonzero(inliers))
    basis = _perpendicular(fit.shaft)
    covariance = basis @ by_axes[:2, :2] @ basis.T
    sigma = math.sqrt(float(np.trace(covariance)))
    detail = f"sigma of the shaft is {math.degrees(sigma):.3g} degrees"
    accepted = sigma <= max_sigma_rad
    return SpinResult(
        tool_frame=poses.source,
        shaft=fit.shaft * np.sign(along_tip),
        covariance=covariance,
        residuals_rad=_angles(fit, poses.rotations),
        turn_rad=float(turns.max()),
        outliers=tuple(np.flatnonzero(~inliers).tolist()),
        accepted=accepted,
        reason=f"{detail} from {int(inliers.sum())} of {len(inliers)} poses"
        if accepted
        else f"{detail}; expected at most {math.degrees(max_sigma_rad):.3g} degrees",
    )


def _fit_axis(rotations: FloatArray, sigma_rad: float) -> _Fit:
    left, _, right = np.linalg.svd(rotations.sum(axis=0))
    return _Fit(right[0], left[:, 0], sigma_rad)


def _angles(fit: _Fit, rotations: FloatArray) -> FloatArray:
    directions = rotations @ fit.shaft
    cross = np.linalg.norm(np.cross(directions, fit.mean_direction), axis=1)
    return np.asarray(np.arctan2(cross, directions @ fit.mean_direction))


def _linearise(fit: _Fit, rotations: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return misfits (n, 2) of the shaft and their Jacobian (n, 2, 4), both in sigmas.

    A misfit is perpendicular to the mean direction and as long as the angle in rad between shaft
    and mean direction. The parameters are small rotations of the shaft and of the mean direction.
    """
    mean_basis, shaft_basis = _perpendicular(fit.mean_direction), _perpendicular(fit.shaft)
    components = rotations @ fit.shaft @ mean_basis
    length = np.maximum(np.linalg.norm(components, axis=1), 1e-300)
    misfits = components * (_angles(fit, rotations) / length)[:, None]
    by_shaft = mean_basis.T @ rotations @ shaft_basis
    by_mean = np.broadcast_to(-np.eye(2), by_shaft.shape)
    return misfits / fit.sigma_rad, np.concatenate([by_shaft, by_mean], axis=2) / fit.sigma_rad


def _perpendicular(direction: FloatArray) -> FloatArray:
    """Orthonormal basis (3, 2) of the plane perpendicular to a direction (3,)."""
    return np.asarray(np.linalg.svd(direction[None])[2][1:].T)


def tip_transform(
    tip_mm: ArrayLike, shaft: ArrayLike, *, tool_frame: str, tip_frame: str
) -> Transform:
    """Return ``tool_from_tip``: origin at ``tip_mm`` (3,), +z along ``shaft`` (3,), tool frame.

    The shaft points from the sensor to the tip. Pivot and spin do not determine the rotation about
    the shaft: +x is the tool's x-axis projected perpendicular to the shaft, or its y-axis if x is
    within 26 degrees of the shaft. Raises `ShapeError` for a shaft of length 0.
    """
    tip = as_point(tip_mm, "tip_mm")
    axis = as_point(shaft, "shaft")
    length = float(np.linalg.norm(axis))
    if length < 1e-9:
        raise ShapeError(f"shaft is {axis.tolist()}; expected a vector that is not 0")
    z = axis / length
    axis_hint = np.eye(3)[0] if abs(z[0]) < 0.9 else np.eye(3)[1]
    x = axis_hint - (axis_hint @ z) * z
    x /= np.linalg.norm(x)
    return Transform(tool_frame, tip_frame, np.column_stack([x, np.cross(z, x), z]), tip)
