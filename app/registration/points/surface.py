"""Surface registration: points touched anywhere on a surface, laid on its mesh.

Closest points on the triangles come from trimesh; its own ICP moves the points by the closed form
for pairs, which creeps along the surface and gives no uncertainty. Here each step is the least
squares of the distances to the surface (point to plane, Chen and Medioni 1992), whose curvature is
the uncertainty: what the surface lets slide is seen, and refused.
"""

import math
from dataclasses import dataclass
from itertools import product

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from app.geometry import FloatArray, FrameError, SurfaceMesh, Transform
from app.registration.errors import (
    ConvergenceError,
    FreeMotionError,
    NoConsensusError,
    ShapeError,
    TooFewError,
)
from app.registration.inputs import as_points, check_spread
from app.registration.least_squares import least_squares
from app.registration.motion import move_origin, moved, point_jacobian
from app.registration.uncertainty.acceptance import AcceptanceLimits, judge
from app.registration.uncertainty.result import RegistrationResult

MIN_POINTS = 12
"""Six are determined exactly and leave nothing to check them by."""

MAX_CONDITION = 30.0
"""A surface along which the touched points slide thirty times more easily than against it."""

STARTS_RAD = math.radians(12.0)
"""How far the given start is turned to either side, about each axis, for the other starts."""

SAME_MM = 0.05
"""Starts that end nearer together than this, RMS of the points, ended at one place."""

RIVAL_RATIO = 1.3
"""Another place with misfits up to this many times the best one's fits as well."""

MAX_STEPS = 80

SETTLED_MM = 1e-5
"""Where a triangle ends the distances have a kink: the last digits would be spent on it."""

MAX_TRIMS = 10
MEDIAN_TO_SIGMA = 1.4826


@dataclass(frozen=True, slots=True, eq=False)
class _Surface:
    query: trimesh.proximity.ProximityQuery
    normals: FloatArray

    @classmethod
    def of(cls, mesh: SurfaceMesh) -> "_Surface":
        shape = trimesh.Trimesh(mesh.vertices_mm, mesh.faces, process=False)
        query = trimesh.proximity.ProximityQuery(shape)  # type: ignore[no-untyped-call]
        return cls(query, np.array(shape.face_normals))

    def distances(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Signed distance (n,), positive outside, and its gradient (n, 3)."""
        closest, length, face = self.query.on_surface(points)
        normals = self.normals[face]
        away = points - closest
        side = np.where(np.sum(away * normals, axis=1) < 0.0, -1.0, 1.0)
        # The way to the closest point, where it is long enough to have a direction.
        clear = length > 1e-6
        gradients = np.where(
            clear[:, None], side[:, None] * away / np.where(clear, length, 1.0)[:, None], normals
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
    """``surface.frame`` from the touched points' frame, from n >= 12 points (n, 3) in mm.

    ``start``, say from three rough landmarks, has to be within some ten degrees: the fit is local,
    and it is repeated from turned starts. ``noise_mm`` is the standard deviation of a touched point
    across the surface, estimated from the misfits when not given. Points farther than ``inlier_mm``
    from the surface after the fit are dropped and named. In the result, residuals are distances to
    the surface and leave-one-out errors are predicted ones (PRESS). The covariance is of first
    order: where the surface bends within a few times the noise, sigma is up to a fifth too small.

    Raises `FreeMotionError` when the points may slide on the surface (plane, sphere, cylinder),
    `NoConsensusError` when two places fit alike or most points are far, and the errors of bad
    points.
    """
    touched = as_points(touched_mm, "touched_mm")
    if len(touched) < MIN_POINTS:
        raise TooFewError(f"{len(touched)} touched points: at least {MIN_POINTS} wanted")
    for name, value in (("noise_mm", noise_mm), ("inlier_mm", inlier_mm)):
        if value is not None and not (math.isfinite(value) and value > 0.0):
            raise ShapeError(f"{name} is {value}: above 0 wanted")
    if start.target != surface.frame:
        raise FrameError(
            f"start is {start.target}_from_{start.source}: its target is not the surface's frame "
            f"{surface.frame!r}"
        )
    check_spread(touched, "touched_mm")
    shape = _Surface.of(surface)
    transform, good = _trimmed(touched, shape, _best_place(touched, shape, start), inlier_mm)

    here = transform.apply(touched)
    distances, gradients = shape.distances(here)
    centre = here[good].mean(axis=0)
    jacobian = _jacobian(here[good], gradients[good], centre)
    arm = math.sqrt(2.0 / 3.0 * float(np.mean(np.sum((here[good] - centre) ** 2, axis=1))))
    condition = float(np.linalg.cond(jacobian * np.repeat([1.0 / arm, 1.0], 3)))
    if condition > MAX_CONDITION:
        raise FreeMotionError(
            f"the touched points may slide on the surface: condition {condition:.3g}, "
            f"{MAX_CONDITION:g} allowed (a plane, a sphere or a cylinder holds no point in place)"
        )
    freedom = int(good.sum()) - 6
    rms = math.sqrt(float(np.mean(distances[good] ** 2)))
    sigma = noise_mm or rms * math.sqrt(good.sum() / freedom)
    inverse = np.linalg.inv(jacobian.T @ jacobian)
    held = np.einsum("ni,ij,nj->n", jacobian, inverse, jacobian)
    left_out = np.full(len(touched), np.nan)
    left_out[good] = np.abs(distances[good]) / (1.0 - held)
    result = RegistrationResult(
        transform=transform,
        residuals_mm=np.abs(distances),
        fre_mm=rms,
        fle_mm=math.sqrt(3.0) * sigma,
        leave_one_out_mm=left_out,
        covariance=move_origin(sigma**2 * np.asarray(inverse), -centre),
        condition=condition,
        accepted=False,
        reason="not judged at any target",
        method="surface",
        degrees_of_freedom=freedom if noise_mm is None else None,
        outliers=tuple(np.flatnonzero(~good).tolist()),
    )
    targets = here[good] if targets_mm is None else as_points(targets_mm, "targets_mm")
    return judge(result, targets, limits or AcceptanceLimits())


def _jacobian(points: FloatArray, gradients: FloatArray, centre: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("ni,nij->nj", gradients, point_jacobian(points - centre)))


def _fit(touched: FloatArray, shape: _Surface, start: Transform) -> Transform:
    centre = start.apply(touched).mean(axis=0)

    def linearise(state: Transform) -> tuple[FloatArray, FloatArray]:
        here = state.apply(touched)
        distances, gradients = shape.distances(here)
        return -distances, _jacobian(here, gradients, centre)

    return least_squares(
        start,
        linearise,
        lambda state, step: moved(state, step, centre),
        "surface registration",
        settled_at=SETTLED_MM,
        max_steps=MAX_STEPS,
    )


def _best_place(touched: FloatArray, shape: _Surface, start: Transform) -> Transform:
    """The best fit from the start and from starts turned about its axes; refuses two that fit."""
    turns = [np.zeros(3)]
    turns += [sign * axis for axis, sign in product(STARTS_RAD * np.eye(3), (1.0, -1.0))]
    centre = start.apply(touched).mean(axis=0)
    places: list[tuple[float, Transform, FloatArray]] = []
    for turn in turns:
        begin = moved(start, np.concatenate([turn, np.zeros(3)]), centre)
        try:
            place = _fit(touched, shape, begin)
        except (ConvergenceError, np.linalg.LinAlgError):
            continue  # a start that leads nowhere is no place; the others are compared
        here = place.apply(touched)
        places.append((float(np.median(np.abs(shape.distances(here)[0]))), place, here))
    if not places:
        raise ConvergenceError("surface registration did not settle from any start")
    places.sort(key=lambda entry: entry[0])
    median, best, there = places[0]
    for other_median, _, here in places[1:]:
        apart = float(np.sqrt(np.mean(np.sum((here - there) ** 2, axis=1))))
        if other_median <= RIVAL_RATIO * median + 1e-6 and apart > max(SAME_MM, 10.0 * median):
            raise NoConsensusError(
                f"two places that are {apart:.3g} mm apart fit alike: misfits of {median:.3g} mm "
                f"and {other_median:.3g} mm (median)"
            )
    return best


def _trimmed(
    touched: FloatArray, shape: _Surface, place: Transform, inlier_mm: float | None
) -> tuple[Transform, NDArray[np.bool_]]:
    """Refit without the points that are too far from the surface, until they stay the same."""
    good = np.ones(len(touched), dtype=bool)
    if inlier_mm is None:
        return place, good
    # The first fit was pulled by what is wrong: its better half decides where to go on from.
    distances = np.abs(shape.distances(place.apply(touched))[0])
    good = distances <= max(inlier_mm, MEDIAN_TO_SIGMA * float(np.median(distances)))
    for _ in range(MAX_TRIMS):
        place = _fit(touched[good], shape, place)
        again = np.abs(shape.distances(place.apply(touched))[0]) <= inlier_mm
        least = max(MIN_POINTS, len(touched) // 2 + 1)
        if again.sum() < least:
            raise NoConsensusError(
                f"only {int(again.sum())} of {len(touched)} touched points are within "
                f"{inlier_mm:g} mm of the surface: at least {least} wanted"
            )
        if np.array_equal(again, good):
            return place, good
        good = again
    raise NoConsensusError(
        f"which touched points are on the surface did not settle in {MAX_TRIMS} rounds"
    )
