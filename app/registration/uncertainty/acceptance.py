"""Whether a registration may be used: by its predicted error at the target, never by its FRE.

Goodness of fit says nothing about the target error of the registration at hand (Fitzpatrick 2009,
"Fiducial registration error and target registration error are uncorrelated"). What can be judged
is the predicted error where it matters, with the luck of few points taken into account, and
whether the points foretell each other.
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
    """Bounds in mm on the 95 % upper bound of sigma TRE, and on every leave-one-out error.

    The values that stand here are for EM tracking beside soft tissue: a clean EM field is good to
    about 1 mm in an operating room, so a point that the others miss by 5 mm is a blunder.
    """

    tre_mm: float = 2.0
    leave_one_out_mm: float = 5.0

    def __post_init__(self) -> None:
        for name in ("tre_mm", "leave_one_out_mm"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0.0):
                raise ShapeError(f"{name} of the acceptance limits is {value}: above 0 wanted")


def judge(
    result: RegistrationResult, targets_mm: ArrayLike, limits: AcceptanceLimits
) -> RegistrationResult:
    """The same result with the verdict for targets (m, 3) in mm in the fixed frame.

    Raises `CovarianceError` for a given registration: there is nothing to judge it by.
    """
    if result.covariance is None:
        raise CovarianceError(f"a {result.method!r} registration cannot be judged: no covariance")
    targets = as_points(targets_mm, "targets_mm")
    bounds = tre_upper_bound(result, targets)
    worst = int(np.argmax(bounds))
    findings = [
        f"predicted TRE of {bounds[worst]:.3g} mm RMS at most (95 %) at the worst of "
        f"{len(targets)} targets"
    ]
    faults = []
    # What is no number is not below a limit; `argmax` finds it first.
    if not bounds[worst] <= limits.tre_mm:
        faults.append(
            f"predicted TRE may be {bounds[worst]:.3g} mm RMS (95 %) at target {worst} "
            f"({', '.join(f'{x:.1f}' for x in targets[worst])}), {limits.tre_mm:g} mm allowed"
        )
    left_out = result.leave_one_out_mm
    if np.isfinite(left_out).any():
        point = int(np.nanargmax(left_out))
        findings.append(f"leave-one-out at most {left_out[point]:.3g} mm")
        if left_out[point] > limits.leave_one_out_mm:
            faults.append(
                f"the other points miss point {point} by {left_out[point]:.3g} mm "
                f"(leave-one-out), {limits.leave_one_out_mm:g} mm allowed"
            )
    else:
        findings.append("leave-one-out not possible")
    return replace(result, accepted=not faults, reason="; ".join(faults or findings))
