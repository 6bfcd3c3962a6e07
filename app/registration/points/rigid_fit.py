"""The best rigid motion between paired points.

Isotropic noise that is equal for all points: closed form (Arun, Huang and Blostein 1987; Horn 1987;
Kabsch 1976). Other noise: maximum likelihood by Levenberg-Marquardt, started at the closed form.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from app.geometry import FloatArray, Transform
from app.registration.errors import ConvergenceError, MirroredPointsError
from app.registration.inputs import as_covariances
from app.registration.least_squares import least_squares
from app.registration.motion import apply_motion, point_jacobian

MAX_REFITS = 50
CONVERGED_RAD = 1e-12

MIRROR_RATIO = 3.0
"""Minimum ratio, for mirrored points, of the extent out of their best plane to the misfit of the
reflection. Flat landmarks are below it: a reflection at their plane is also a rigid motion."""

FLAT_RATIO = 1e-3
"""Points with a smaller ratio of the extent out of their plane to the extent within it are flat."""


@dataclass(frozen=True, slots=True, eq=False)
class PairNoise:
    """Covariances (n, 3, 3) in mm2 of the fixed and the moving points, each in its own frame."""

    fixed_mm2: FloatArray
    moving_mm2: FloatArray

    @classmethod
    def from_covariances(
        cls, fixed: ArrayLike | None, moving: ArrayLike | None, count: int
    ) -> "PairNoise | None":
        """Construct from covariances (3, 3) or (n, 3, 3); None if both are None."""
        if fixed is None and moving is None:
            return None
        zero = np.zeros((count, 3, 3))
        return cls(
            zero if fixed is None else as_covariances(fixed, count, "covariances_mm2"),
            zero if moving is None else as_covariances(moving, count, "moving_covariances_mm2"),
        )

    def total_mm2(self, rotation: FloatArray) -> FloatArray:
        """Covariance of the misfit of each pair in the fixed frame, (n, 3, 3)."""
        return self.fixed_mm2 + rotation @ self.moving_mm2 @ rotation.T

    def variances_mm2(self) -> FloatArray:
        """Variance (n,) of each pair, averaged over the axes; independent of the rotation."""
        return np.asarray(np.trace(self.fixed_mm2 + self.moving_mm2, axis1=1, axis2=2) / 3.0)

    def select(self, mask: NDArray[np.bool_]) -> "PairNoise":
        """Return the noise of the pairs of a mask (n,)."""
        return PairNoise(self.fixed_mm2[mask], self.moving_mm2[mask])


def fit_rigid(
    fixed: FloatArray,
    moving: FloatArray,
    noise: PairNoise | None,
    fixed_frame: str,
    moving_frame: str,
) -> Transform:
    """Compute ``fixed_from_moving`` from validated points (n, 3) in mm.

    Raises `MirroredPointsError` and `ConvergenceError`.
    """
    weights = np.ones(len(fixed)) if noise is None else 1.0 / noise.variances_mm2()
    start = _closed_form(fixed, moving, weights / weights.sum(), fixed_frame, moving_frame)
    return start if noise is None else _maximum_likelihood(fixed, moving, noise, start)


def _closed_form(
    fixed: FloatArray, moving: FloatArray, weights: FloatArray, fixed_frame: str, moving_frame: str
) -> Transform:
    fixed_centre, moving_centre = weights @ fixed, weights @ moving
    centred_fixed, centred_moving = fixed - fixed_centre, moving - moving_centre
    left, values, right = np.linalg.svd(centred_fixed.T @ (weights[:, None] * centred_moving))
    handedness = float(np.sign(np.linalg.det(left) * np.linalg.det(right)))
    if handedness < 0.0:
        mirror_misfit = np.linalg.norm(centred_fixed - centred_moving @ (left @ right).T, axis=1)
        rms = float(np.sqrt(weights @ mirror_misfit**2))
        out_of_plane = float(np.sqrt(values[2]))
        if out_of_plane > max(MIRROR_RATIO * rms, FLAT_RATIO * float(np.sqrt(values[0]))):
            raise MirroredPointsError(
                f"the {len(fixed)} moving points are a mirror image of the fixed ones: a "
                f"reflection fits within {rms:.3g} mm RMS and they extend {out_of_plane:.3g} mm "
                "out of their plane; expected points that a rigid motion maps"
            )
    rotation = left @ np.diag([1.0, 1.0, handedness]) @ right
    translation = fixed_centre - rotation @ moving_centre
    return Transform(fixed_frame, moving_frame, rotation, translation)


def _maximum_likelihood(
    fixed: FloatArray, moving: FloatArray, noise: PairNoise, start: Transform
) -> Transform:
    """Minimise the sum of ``r_i^T C_i^-1 r_i``, where the rotation changes ``C_i``, too."""
    centre = fixed.mean(axis=0)
    estimate = start
    for _ in range(MAX_REFITS):
        # The inverse Cholesky factor whitens the misfits.
        whiten = np.linalg.inv(np.linalg.cholesky(noise.total_mm2(estimate.rotation)))

        def linearise(
            state: Transform, whiten: FloatArray = whiten
        ) -> tuple[FloatArray, FloatArray]:
            mapped = state.apply(moving)
            misfit = np.einsum("nij,nj->ni", whiten, fixed - mapped)
            return misfit.ravel(), (whiten @ point_jacobian(mapped - centre)).reshape(-1, 6)

        before, estimate = (
            estimate,
            least_squares(
                estimate,
                linearise,
                lambda state, step: apply_motion(state, step, centre),
                "registration",
            ),
        )
        if not noise.moving_mm2.any() or before.angle_to(estimate) < CONVERGED_RAD:
            return estimate
    raise ConvergenceError(
        f"weights by the rotated covariances did not converge in {MAX_REFITS} fits"
    )
