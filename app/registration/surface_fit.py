"""Registration of points touched anywhere on a surface to its mesh.

Each step minimises the distances to the surface (point to plane, Chen and Medioni 1992), whose
Hessian gives the uncertainty; points that can slide along the surface are detected by it. The ICP
of trimesh minimises distances between point pairs instead: it converges slowly along the surface
and gives no uncertainty. Closest points on the triangles are from trimesh.
"""

import math
from dataclasses import dataclass
from itertools import product

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from app.geometry import FloatArray, FrameError, SurfaceMesh, Transform
from app.registration.input_checks import (
    ConvergenceError,
    FreeMotionError,
    NoConsensusError,
    ShapeError,
    TooFewError,
    as_points,
    check_spread,
)
from app.registration.registration_checks import AcceptanceLimits, evaluate_acceptance
from app.registration.registration_result import RegistrationResult
from app.registration.small_motion import apply_motion, least_squares, move_origin, point_jacobian

MIN_POINTS = 12
"""Six points determine the motion exactly; more are needed for a check."""

MAX_CONDITION = 30.0
"""Maximum condition number; above it the points can slide along the surface."""

START_ROTATION_RAD = math.radians(12.0)
"""Rotation, in both directions about each axis, of the further starts from the given one."""

DISTINCT_MM = 0.05
"""Fits whose points differ by less (RMS) are the same fit."""

AMBIGUITY_RATIO = 1.3
"""A different fit with a median misfit up to this ratio of the best one makes it ambiguous."""

MAX_STEPS = 80

CONVERGED_MM = 1e-5
"""Convergence limit: smaller steps only follow the kinks of the distance at triangle edges."""

MAX_REFITS = 10
MEDIAN_TO_SIGMA = 1.4826


@dataclass(frozen=True, slots=True, eq=False)
class _Surface:
    query: trimesh.proximity.ProximityQuery
    normals: FloatArray

    @classmethod
    def from_mesh(cls, mesh: SurfaceMesh) -> "_Surface":
        shape = trimesh.Trimesh(mesh.vertices_mm, mesh.faces, process=False)
        query = trimesh.proximity.ProximityQuery(shape)  # type: ignore[no-untyped-call]
        return cls(query, np.array(shape.face_normals))

    def distances(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return signed distances (n,) in mm, positive outside, and their gradients (n, 3)."""
        closest, length, face = self.query.on_surface(points)
        normals = self.normals[face]
        offset = points - closest
        side = np.where(np.sum(offset * normals, axis=1) < 0.0, -1.0, 1.0)
        # Along the line to the closest point, except where it is too short to have a direction.
        clear = length > 1e-6
        gradients = np.where(
            clear[:, None], side[:, None] * offset / np.where(clear, length, 1.0)[:, None], normals
        )
        return side * length, gradients


def register_surface(
    touched_mm: ArrayLike,
    surface: SurfaceMesh,
    *,
    start: Transform,
    noise_mm: float | None = None,
    inlier_mm: float | None = None,
    targets_mm: ArrayLike | None = None,
    limits: AcceptanceLimits | None = None,
) -> RegistrationResult:
    """Compute the transform from the touched points' frame to ``surface.frame``.

    ``touched_mm`` (n, 3), n >= 12, in mm. ``start``, e.g. from three rough landmarks, must be
    within about ten degrees: the fit is local, and it is repeated from rotated starts. ``noise_mm``
    is the standard deviation of a touched point normal to the surface, by default estimated from
    the residuals. Points farther than ``inlier_mm`` from the surface after the fit are rejected.
    Residuals of the result are distances to the surface, leave-one-out errors are computed without
    refits (PRESS). The covariance is first order: if the surface is curved at the scale of a few
    times the noise, sigma is up to 20 % too small.

    Raises `FreeMotionError` if the points can slide along the surface (plane, sphere, cylinder),
    `NoConsensusError` if two fits are equally good or most points are outliers, `FrameError`,
    and the errors of invalid points.
    """
    touched = as_points(touched_mm, "touched_mm")
    if len(touched) < MIN_POINTS:
        raise TooFewError(f"{len(touched)} touched points; expected at least {MIN_POINTS}")
    for name, value in (("noise_mm", noise_mm), ("inlier_mm", inlier_mm)):
        if value is not None and not (math.isfinite(value) and value > 0.0):
            raise ShapeError(f"{name} is {value}; expected a finite number above 0")
    if start.target != surface.frame:
        raise FrameError(
            f"start is {start.target}_from_{start.source}; expected the target {surface.frame!r}, "
            "the frame of the surface"
        )
    check_spread(touched, "touched_mm")
    shape = _Surface.from_mesh(surface)
    best = _fit_from_starts(touched, shape, start)
    transform, inliers = _fit_inliers(touched, shape, best, inlier_mm)

    mapped = transform.apply(touched)
    distances, gradients = shape.distances(mapped)
    centre = mapped[inliers].mean(axis=0)
    jacobian = _jacobian(mapped[inliers], gradients[inliers], centre)
    arm = math.sqrt(2.0 / 3.0 * float(np.mean(np.sum((mapped[inliers] - centre) ** 2, axis=1))))
    condition = float(np.linalg.cond(jacobian * np.repeat([1.0 / arm, 1.0], 3)))
    if condition > MAX_CONDITION:
        raise FreeMotionError(
            f"the touched points can slide along the surface: condition is {condition:.3g}; "
            f"expected at most {MAX_CONDITION:g} "
            "(a plane, sphere or cylinder does not determine a pose)"
        )
    freedom = int(inliers.sum()) - 6
    rms = math.sqrt(float(np.mean(distances[inliers] ** 2)))
    sigma = noise_mm or rms * math.sqrt(inliers.sum() / freedom)
    inverse = np.linalg.inv(jacobian.T @ jacobian)
    leverage = np.einsum("ni,ij,nj->n", jacobian, inverse, jacobian)
    leave_one_out = np.full(len(touched), np.nan)
    leave_one_out[inliers] = np.abs(distances[inliers]) / (1.0 - leverage)
    result = RegistrationResult(
        transform=transform,
        residuals_mm=np.abs(distances),
        fre_mm=rms,
        fle_mm=math.sqrt(3.0) * sigma,
        leave_one_out_mm=leave_one_out,
        covariance=move_origin(sigma**2 * np.asarray(inverse), -centre),
        condition=condition,
        accepted=False,
        reason="acceptance is not evaluated",
        method="surface",
        degrees_of_freedom=freedom if noise_mm is None else None,
        outliers=tuple(np.flatnonzero(~inliers).tolist()),
    )
    targets = mapped[inliers] if targets_mm is None else as_points(targets_mm, "targets_mm")
    return evaluate_acceptance(result, targets, limits or AcceptanceLimits())


def _jacobian(points: FloatArray, gradients: FloatArray, centre: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("ni,nij->nj", gradients, point_jacobian(points - centre)))


def _fit(touched: FloatArray, shape: _Surface, start: Transform) -> Transform:
    centre = start.apply(touched).mean(axis=0)

    def linearise(state: Transform) -> tuple[FloatArray, FloatArray]:
        mapped = state.apply(touched)
        distances, gradients = shape.distances(mapped)
        return -distances, _jacobian(mapped, gradients, centre)

    return least_squares(
        start,
        linearise,
        lambda state, step: apply_motion(state, step, centre),
        "surface registration",
        tolerance=CONVERGED_MM,
        max_steps=MAX_STEPS,
    )


def _fit_from_starts(touched: FloatArray, shape: _Surface, start: Transform) -> Transform:
    """Return the best fit from ``start`` and from starts rotated about its axes.

    Raises `NoConsensusError` if two different fits are equally good.
    """
    rotations = [np.zeros(3)]
    rotations += [
        sign * axis for axis, sign in product(START_ROTATION_RAD * np.eye(3), (1.0, -1.0))
    ]
    centre = start.apply(touched).mean(axis=0)
    fits: list[tuple[float, Transform, FloatArray]] = []
    for rotation in rotations:
        begin = apply_motion(start, np.concatenate([rotation, np.zeros(3)]), centre)
        try:
            fit = _fit(touched, shape, begin)
        except (ConvergenceError, np.linalg.LinAlgError):
            continue  # only fits that converge are compared
        mapped = fit.apply(touched)
        fits.append((float(np.median(np.abs(shape.distances(mapped)[0]))), fit, mapped))
    if not fits:
        raise ConvergenceError("surface registration did not converge from any start")
    fits.sort(key=lambda entry: entry[0])
    median, best, best_points = fits[0]
    for other_median, _, points in fits[1:]:
        separation = float(np.sqrt(np.mean(np.sum((points - best_points) ** 2, axis=1))))
        similar = other_median <= AMBIGUITY_RATIO * median + 1e-6
        if similar and separation > max(DISTINCT_MM, 10.0 * median):
            raise NoConsensusError(
                f"two fits that are {separation:.3g} mm apart are equally good: median misfits of "
                f"{median:.3g} mm and {other_median:.3g} mm; expected one fit"
            )
    return best


def _fit_inliers(
    touched: FloatArray, shape: _Surface, start: Transform, inlier_mm: float | None
) -> tuple[Transform, NDArray[np.bool_]]:
    """Refit to the points within ``inlier_mm`` of the surface until they stay the same."""
    inliers = np.ones(len(touched), dtype=bool)
    if inlier_mm is None:
        return start, inliers
    # Outliers have shifted the first fit: continue with at least its better half.
    fit = start
    distances = np.abs(shape.distances(fit.apply(touched))[0])
    inliers = distances <= max(inlier_mm, MEDIAN_TO_SIGMA * float(np.median(distances)))
    for _ in range(MAX_REFITS):
        fit = _fit(touched[inliers], shape, fit)
        consistent = np.abs(shape.distances(fit.apply(touched))[0]) <= inlier_mm
        min_inliers = max(MIN_POINTS, len(touched) // 2 + 1)
        if consistent.sum() < min_inliers:
            raise NoConsensusError(
                f"only {int(consistent.sum())} of {len(touched)} touched points are within "
                f"{inlier_mm:g} mm of the surface; expected at least {min_inliers}"
            )
        if np.array_equal(consistent, inliers):
            return fit, inliers
        inliers = consistent
    raise NoConsensusError(f"inliers of the surface did not converge in {MAX_REFITS} refits")
