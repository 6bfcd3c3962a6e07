"""The result of a registration, with its uncertainty and acceptance."""

import math
from dataclasses import dataclass

import numpy as np

from app.geometry import FloatArray, Transform
from app.registration.input_checks import CovarianceError, ShapeError


@dataclass(frozen=True, slots=True, eq=False)
class RegistrationResult:
    """The transform ``fixed_from_moving`` and its quality measures.

    ``residuals_mm`` (n,)
        Distance of each transformed point from its fixed partner, outliers included.
    ``fre_mm``
        Fiducial registration error: root mean square of the residuals without outliers. It measures
        the noise of the points, not the error at a target, and does not affect ``accepted``. None
        for a given registration.
    ``fle_mm``
        Fiducial localisation error: 3-D root mean square error of one point, estimated from
        ``fre_mm`` or taken from given covariances. None for a given registration.
    ``leave_one_out_mm`` (n,)
        Distance of each point from its position by a registration of the other points; NaN if the
        others are too few or collinear, and for outliers.
    ``covariance`` (6, 6) or None
        Of the small motion (rad, mm) defined in `app.registration.small_motion`, in the fixed
        frame. None if the uncertainty is not known.
    ``degrees_of_freedom``
        Degrees of freedom of the noise estimate, fewer where the residuals differ by direction;
        None if the noise was given.
    ``condition``
        Condition number of the fit, dimensionless and 1 at best: rotations are scaled by the spread
        of the points. NaN for a given registration.
    ``outliers``
        Indices of points that were rejected.
    ``accepted``, ``reason``
        Whether the registration may be used, and one line that explains it in either case.

    >>> import marginguard as mg
    >>> corners = [[0, 0, 0], [90, 0, 0], [0, 80, 0], [0, 0, 70]]
    >>> result = mg.register_points(
    ...     corners, corners, fixed_frame="reference", moving_frame="robot_base"
    ... )
    >>> result.transform.source, result.used, result.accepted
    ('robot_base', (0, 1, 2, 3), True)
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
                f"{self.leave_one_out_mm.shape}; expected (n,) for both"
            )
        if self.covariance is not None:
            object.__setattr__(self, "covariance", checked_covariance(self.covariance, 6))
        if not self.reason:
            raise ShapeError("reason of a registration is empty; expected a line that explains it")

    @property
    def used(self) -> tuple[int, ...]:
        """Indices of the points from which the transform was computed."""
        return tuple(i for i in range(len(self.residuals_mm)) if i not in self.outliers)


def given_registration(
    transform: Transform,
    covariance: FloatArray | None = None,
    degrees_of_freedom: int | None = None,
) -> RegistrationResult:
    """Return an accepted registration from a given transform.

    Without ``covariance`` (6, 6) its uncertainty is unknown, and `predict_tre` raises
    `CovarianceError` for it. Raises `CovarianceError` for a matrix that is no covariance.
    """
    error = "its error is not known" if covariance is None else "with its covariance"
    return RegistrationResult(
        transform=transform,
        residuals_mm=np.empty(0),
        fre_mm=None,
        fle_mm=None,
        leave_one_out_mm=np.empty(0),
        covariance=covariance,
        condition=math.nan,
        accepted=True,
        reason=f"given, not computed: {error}",
        method="given",
        degrees_of_freedom=degrees_of_freedom,
    )


def read_only(values: FloatArray) -> FloatArray:
    """Return a read-only float copy."""
    array = np.array(values, dtype=np.float64)
    array.flags.writeable = False
    return array


def checked_covariance(covariance: FloatArray, size: int) -> FloatArray:
    """Return a read-only copy of a covariance (size, size).

    Raises `CovarianceError` unless it is finite, symmetric and positive semidefinite.
    """
    array = np.array(covariance, dtype=np.float64)
    if array.shape != (size, size) or not np.isfinite(array).all():
        raise CovarianceError(
            f"covariance has shape {array.shape}, finite {bool(np.isfinite(array).all())}; "
            f"expected finite ({size}, {size})"
        )
    scale = np.sqrt(np.abs(np.diag(array)))
    if np.any(np.diag(array) < 0.0) or np.any(
        np.abs(array - array.T) > 1e-6 * np.outer(scale, scale) + 1e-300
    ):
        raise CovarianceError(
            f"covariance is {array.tolist()}; expected a symmetric matrix with a diagonal >= 0"
        )
    array = 0.5 * (array + array.T)
    # Correlations give rad and mm the same scale. A negative variance would predict a target error
    # of zero.
    known = scale > 0.0
    correlations = array[np.ix_(known, known)] / np.outer(scale[known], scale[known])
    min_eigenvalue = float(np.linalg.eigvalsh(correlations).min(initial=0.0))
    if min_eigenvalue < -1e-6:
        raise CovarianceError(
            f"covariance has a negative variance along some motion: eigenvalue "
            f"{min_eigenvalue:.3g} of the correlations of {array.tolist()}; expected none below 0"
        )
    return read_only(array)
