"""Covariance of a least-squares fit to poses in order of time, whose errors are correlated.

Neighbouring poses of a tracker have similar errors, so n poses tell less than n independent ones.
The covariance is that of generalised estimating equations (Liang and Zeger, "Longitudinal data
analysis using generalized linear models", 1986): ``A^-1 (sum_ij r_ij J_i^T S J_j) A^-1`` with
``A = sum_i J_i^T J_i``, the correlation ``r_ij`` that `app.geometry.correlated_noise` finds in the
residuals, and their covariance ``S``, which may differ by direction.
"""

import math

import numpy as np
from numpy.typing import NDArray

from app.geometry import FloatArray
from app.geometry.correlated_noise import MAX_SAMPLES, estimate_noise

_ROWS = 500
"""Poses whose correlations with all others are computed at a time."""


def fit_covariance(
    residuals: FloatArray, jacobian: FloatArray, order: NDArray[np.intp]
) -> FloatArray:
    """Covariance (p, p) of the parameters of a fit.

    ``residuals`` (n, a) and their Jacobian (n, a, p) are in standard deviations; ``order`` (n,)
    are the increasing indices of the poses, which are taken as evenly spaced in time.
    """
    count, axes, parameters = jacobian.shape
    times = order.astype(np.float64)
    length = min(count, MAX_SAMPLES)
    starts = range(0, count - length + 1, max(1, length // 2))
    variance, correlation, _ = estimate_noise(
        np.array([times[start : start + length] for start in starts for _ in range(axes)]),
        np.array([residuals[start : start + length, k] for start in starts for k in range(axes)]),
        degree=0,
        overlap=1.0 if len(starts) == 1 else 0.6,
        longest=count / (2.0 * math.pi),
    )
    # The means that `estimate_noise` removes are some of the parameters.
    variance *= count * axes / max(count * axes - (parameters - axes), 1)
    scatter = residuals.T @ residuals
    scatter *= variance * axes / max(float(np.trace(scatter)), 1e-300)
    rows = np.einsum("ab,nap->nbp", np.linalg.cholesky(scatter + 1e-12 * np.eye(axes)), jacobian)
    middle = np.zeros((parameters, parameters))
    for first in range(0, count, _ROWS):
        part = slice(first, first + _ROWS)
        related = np.tensordot(correlation.matrix(times[part], times), rows, axes=1)
        middle += np.einsum("nap,naq->pq", rows[part], related)
    flat = jacobian.reshape(-1, parameters)
    inverse = np.linalg.inv(flat.T @ flat)
    return np.asarray(inverse @ (0.5 * (middle + middle.T)) @ inverse)
