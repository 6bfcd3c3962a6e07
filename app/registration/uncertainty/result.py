"""What a registration found, how sure it is, and whether it may be used."""

import math
from dataclasses import dataclass

import numpy as np

from app.geometry import FloatArray, Transform
from app.registration.errors import CovarianceError, ShapeError


@dataclass(frozen=True, slots=True, eq=False)
class RegistrationResult:
    """``transform`` is ``fixed_from_moving``; everything else says how far to trust it.

    ``residuals_mm`` (n,)
        Distance of each moved point from its fixed partner, points that were dropped included.
    ``fre_mm``
        Root mean square of the residuals of the points that were used. It tells of the noise of
        the points, never of the error at a target, and is no part of ``accepted``. None when the
        registration was given and not computed.
    ``fle_mm``
        3-D root mean square of the localisation error of one point: estimated from ``fre_mm``,
        or of the covariances that were handed in. None when given.
    ``leave_one_out_mm`` (n,)
        Distance of each point from where a registration of the others puts it; NaN where the
        others are too few or collinear, and for points that were dropped.
    ``covariance`` (6, 6) or None
        Of the small motion (rad, mm) defined in `app.registration.motion`, in the fixed frame.
        None when nothing is known of it.
    ``degrees_of_freedom``
        How much data the noise level was estimated from; None when the noise was handed in.
    ``condition``
        Condition number of the fit, with rotations measured at the spread of the points, so that
        it is 1 at best and has no unit. NaN when given.
    ``outliers``
        Indices of points that were named wrong and dropped.
    ``accepted``, ``reason``
        The verdict and the one line that explains it, for either outcome.
    """

    transform: Transform
    residuals_mm: FloatArray
    fre_mm: float | None
    fle_mm: float | None
    leave_one_out_mm: FloatArray
    covariance: FloatArray | None
    condition: float
    accepted: bool
    reason: str
    method: str
    degrees_of_freedom: int | None = None
    outliers: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        for name in ("residuals_mm", "leave_one_out_mm"):
            object.__setattr__(self, name, read_only(getattr(self, name)))
        if self.residuals_mm.shape != self.leave_one_out_mm.shape or self.residuals_mm.ndim != 1:
            raise ShapeError(
                f"residuals_mm has shape {self.residuals_mm.shape} and leave_one_out_mm "
                f"{self.leave_one_out_mm.shape}: (n,) for both wanted"
            )
        if self.covariance is not None:
            object.__setattr__(self, "covariance", checked_covariance(self.covariance, 6))
        if not self.reason:
            raise ShapeError("reason of a registration is empty: a line that explains it wanted")

    @property
    def used(self) -> tuple[int, ...]:
        """Indices of the points that the transform was computed from."""
        return tuple(i for i in range(len(self.residuals_mm)) if i not in self.outliers)


def given_registration(transform: Transform) -> RegistrationResult:
    """A registration that somebody stated: accepted as stated, with an unknown uncertainty.

    `predict_tre` refuses it, because a number for its error would be made up.
    """
    return RegistrationResult(
        transform=transform,
        residuals_mm=np.empty(0),
        fre_mm=None,
        fle_mm=None,
        leave_one_out_mm=np.empty(0),
        covariance=None,
        condition=math.nan,
        accepted=True,
        reason="given and not computed: its error is not known",
        method="given",
    )


def read_only(values: FloatArray) -> FloatArray:
    """A read-only float copy."""
    array = np.array(values, dtype=np.float64)
    array.flags.writeable = False
    return array


def checked_covariance(covariance: FloatArray, size: int) -> FloatArray:
    """A read-only copy of a (size, size) covariance: finite, symmetric, not negative."""
    array = np.array(covariance, dtype=np.float64)
    if array.shape != (size, size) or not np.isfinite(array).all():
        raise CovarianceError(
            f"covariance has shape {array.shape}, finite {bool(np.isfinite(array).all())}: "
            f"finite ({size}, {size}) wanted"
        )
    scale = np.sqrt(np.abs(np.diag(array)))
    if np.any(np.diag(array) < 0.0) or np.any(
        np.abs(array - array.T) > 1e-6 * np.outer(scale, scale) + 1e-300
    ):
        raise CovarianceError(f"covariance is not symmetric with a diagonal >= 0: {array.tolist()}")
    array = 0.5 * (array + array.T)
    # As correlations, so that rad and mm weigh alike. A sum of the entries below 0 would pass for
    # no error at all where a target error is predicted.
    known = scale > 0.0
    correlations = array[np.ix_(known, known)] / np.outer(scale[known], scale[known])
    least = float(np.linalg.eigvalsh(correlations).min(initial=0.0))
    if least < -1e-6:
        raise CovarianceError(
            f"covariance has a negative variance along some motion (eigenvalue {least:.3g} of its "
            f"correlations): {array.tolist()}"
        )
    return read_only(array)
