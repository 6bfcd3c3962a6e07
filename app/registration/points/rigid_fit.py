"""The best rigid motion between paired points: closed form, and maximum likelihood on top of it.

Equal noise: closed form (Arun, Huang and Blostein 1987; Horn 1987; Kabsch 1976). Noise that
differs between points or directions: the closed form is where a Levenberg-Marquardt iteration on
the motion starts.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from app.geometry import FloatArray, Transform
from app.registration.errors import ConvergenceError, MirroredPointsError
from app.registration.inputs import as_covariances
from app.registration.least_squares import least_squares
from app.registration.motion import moved, point_jacobian

MAX_TURNS = 50
SAME_TURN_RAD = 1e-12

MIRROR_RATIO = 3.0
"""Points that a mirror maps well and no motion does stand out of their best plane by more than
this many times the misfit of the mirror. Flat landmarks do not: their mirror image is a motion."""

FLAT_RATIO = 1e-3
"""Points that stand out of their plane by less than this part of their extent are flat."""


@dataclass(frozen=True, slots=True, eq=False)
class PairNoise:
    """Covariances (n, 3, 3) in mm2 of the fixed points, and of the moving ones in their frame."""

    fixed_mm2: FloatArray
    moving_mm2: FloatArray

    @classmethod
    def of(
        cls, fixed: ArrayLike | None, moving: ArrayLike | None, count: int
    ) -> "PairNoise | None":
        """From what the caller knows; None when that is nothing."""
        if fixed is None and moving is None:
            return None
        none = np.zeros((count, 3, 3))
        return cls(
            none if fixed is None else as_covariances(fixed, count, "covariances_mm2"),
            none if moving is None else as_covariances(moving, count, "moving_covariances_mm2"),
        )

    def total_mm2(self, rotation: FloatArray) -> FloatArray:
        """Covariance of the misfit of each pair in the fixed frame, (n, 3, 3)."""
        return self.fixed_mm2 + rotation @ self.moving_mm2 @ rotation.T

    def variances_mm2(self) -> FloatArray:
        """Mean variance of an axis for each pair, (n,): what the turn does not change."""
        return np.asarray(np.trace(self.fixed_mm2 + self.moving_mm2, axis1=1, axis2=2) / 3.0)

    def of_points(self, kept: NDArray[np.bool_]) -> "PairNoise":
        """The noise of some of the pairs, by a mask (n,)."""
        return PairNoise(self.fixed_mm2[kept], self.moving_mm2[kept])


def fit_rigid(
    fixed: FloatArray,
    moving: FloatArray,
    noise: PairNoise | None,
    fixed_frame: str,
    moving_frame: str,
) -> Transform:
    """``fixed_from_moving`` for checked points (n, 3); raises `MirroredPointsError`."""
    weights = np.ones(len(fixed)) if noise is None else 1.0 / noise.variances_mm2()
    start = _closed_form(fixed, moving, weights / weights.sum(), fixed_frame, moving_frame)
    return start if noise is None else _maximum_likelihood(fixed, moving, noise, start)


def _closed_form(
    fixed: FloatArray, moving: FloatArray, weights: FloatArray, fixed_frame: str, moving_frame: str
) -> Transform:
    fixed_centre, moving_centre = weights @ fixed, weights @ moving
    centred_fixed, centred_moving = fixed - fixed_centre, moving - moving_centre
    left, values, right = np.linalg.svd(centred_fixed.T @ (weights[:, None] * centred_moving))
    hand = float(np.sign(np.linalg.det(left) * np.linalg.det(right)))
    if hand < 0.0:
        mirror_misfit = np.linalg.norm(centred_fixed - centred_moving @ (left @ right).T, axis=1)
        rms = float(np.sqrt(weights @ mirror_misfit**2))
        out_of_plane = float(np.sqrt(values[2]))
        if out_of_plane > max(MIRROR_RATIO * rms, FLAT_RATIO * float(np.sqrt(values[0]))):
            raise MirroredPointsError(
                f"the {len(fixed)} moving points are a mirror image of the fixed ones: a mirror "
                f"leaves {rms:.3g} mm RMS and they stand {out_of_plane:.3g} mm out of their plane"
            )
    rotation = left @ np.diag([1.0, 1.0, hand]) @ right
    translation = fixed_centre - rotation @ moving_centre
    return Transform(fixed_frame, moving_frame, rotation, translation)


def _maximum_likelihood(
    fixed: FloatArray, moving: FloatArray, noise: PairNoise, start: Transform
) -> Transform:
    """Minimise the sum of ``r_i^T C_i^-1 r_i``, with the moving part of ``C_i`` turned along."""
    centre = fixed.mean(axis=0)
    estimate = start
    for _ in range(MAX_TURNS):
        # Rows of the inverse Cholesky factor: they make each misfit white.
        whiten = np.linalg.inv(np.linalg.cholesky(noise.total_mm2(estimate.rotation)))

        def linearise(
            state: Transform, whiten: FloatArray = whiten
        ) -> tuple[FloatArray, FloatArray]:
            here = state.apply(moving)
            misfit = np.einsum("nij,nj->ni", whiten, fixed - here)
            return misfit.ravel(), (whiten @ point_jacobian(here - centre)).reshape(-1, 6)

        before, estimate = (
            estimate,
            least_squares(
                estimate, linearise, lambda state, step: moved(state, step, centre), "registration"
            ),
        )
        if not noise.moving_mm2.any() or before.angle_to(estimate) < SAME_TURN_RAD:
            return estimate
    raise ConvergenceError(f"the turn of the moving covariances did not settle in {MAX_TURNS} fits")
