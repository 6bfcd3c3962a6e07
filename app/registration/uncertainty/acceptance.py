"""Acceptance of a registration by its predicted target error, not by its FRE.

The fiducial registration error (FRE) says nothing about the target error of one registration
(Fitzpatrick 2009, "Fiducial registration error and target registration error are uncorrelated").
The criteria are the predicted error at the targets, with a confidence bound for few points, and
the leave-one-out errors.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from app.registration.errors import CovarianceError, ShapeError
from app.registration.inputs import as_points
from app.registration.uncertainty.result import RegistrationResult
from app.registration.uncertainty.tre import tre_upper_bound


@dataclass(frozen=True, slots=True)
class AcceptanceLimits:
    """Limits in mm of the 95 % upper bound of sigma TRE and of every leave-one-out error.

    The defaults are for EM tracking of soft tissue. In an undistorted field EM tracking is accurate
    to about 1 mm in an operating room, so a leave-one-out error of 5 mm is a gross error.
    """

    tre_mm: float = 2.0
    leave_one_out_mm: float = 5.0

    def __post_init__(self) -> None:
        for name in ("tre_mm", "leave_one_out_mm"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0.0):
                raise ShapeError(
                    f"{name} of the acceptance limits is {value}; expected a finite number above 0"
                )


def evaluate_acceptance(
    result: RegistrationResult, targets_mm: ArrayLike, limits: AcceptanceLimits
) -> RegistrationResult:
    """Return ``result`` with ``accepted`` and ``reason`` for targets (m, 3) in mm.

    The targets are in the fixed frame. Raises `CovarianceError` for a registration without a
    covariance.
    """
    if result.covariance is None:
        raise CovarianceError(
            f"acceptance of a {result.method!r} registration cannot be evaluated; "
            "expected a registration with a covariance"
        )
    targets = as_points(targets_mm, "targets_mm")
    bounds = tre_upper_bound(result, targets)
    worst = int(np.argmax(bounds))
    details = [
        f"predicted TRE is at most {bounds[worst]:.3g} mm RMS (95 %) at the worst of "
        f"{len(targets)} targets"
    ]
    faults = []
    # `not <=` also rejects NaN, which `argmax` returns first.
    if not bounds[worst] <= limits.tre_mm:
        faults.append(
            f"predicted TRE may be {bounds[worst]:.3g} mm RMS (95 %) at target {worst} "
            f"({', '.join(f'{x:.1f}' for x in targets[worst])}); "
            f"expected at most {limits.tre_mm:g} mm"
        )
    leave_one_out = result.leave_one_out_mm
    if np.isfinite(leave_one_out).any():
        point = int(np.nanargmax(leave_one_out))
        details.append(f"leave-one-out error is at most {leave_one_out[point]:.3g} mm")
        if leave_one_out[point] > limits.leave_one_out_mm:
            faults.append(
                f"leave-one-out error of point {point} is {leave_one_out[point]:.3g} mm; "
                f"expected at most {limits.leave_one_out_mm:g} mm"
            )
    else:
        details.append("leave-one-out error is not available")
    return replace(result, accepted=not faults, reason="; ".join(faults or details))
