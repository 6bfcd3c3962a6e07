"""Independent test of which observations agree with a fit, by explicit leave-one-out refits.

Independent of `app.registration.consensus`: refits without each observation by ``numpy.linalg``
and takes quantiles from ``scipy.stats``, where the code updates one fit by its hat matrix.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2
from scipy.stats import f as fisher

from app.geometry import FloatArray


def consistent_by_refits(
    values: FloatArray,
    design: FloatArray,
    inliers: NDArray[np.bool_],
    sigma: float | None,
    false_rejection_rate: float,
) -> list[bool]:
    """Test each observation (n, 2) against a linear fit to the other inliers.

    ``design`` (n, 2, 3) holds the linear model; ``sigma`` None estimates the noise from the refit.
    """
    rate = 1.0 - false_rejection_rate / len(values)
    verdicts = []
    for one in range(len(values)):
        others = inliers & (np.arange(len(values)) != one)
        rows, right = design[others].reshape(-1, 3), values[others].ravel()
        answer, (rest,), *_ = np.linalg.lstsq(rows, right, rcond=None)
        freedom = len(right) - 3
        variance = rest / freedom if sigma is None else sigma**2
        spread = np.eye(2) + design[one] @ np.linalg.inv(rows.T @ rows) @ design[one].T
        misfit = values[one] - design[one] @ answer
        squared = misfit @ np.linalg.solve(spread, misfit) / variance
        bound = 2.0 * fisher.ppf(rate, 2, freedom) if sigma is None else chi2.ppf(rate, 2)
        verdicts.append(bool(squared <= bound))
    return verdicts
