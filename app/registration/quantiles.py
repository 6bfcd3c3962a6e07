"""Quantiles of distributions, without `scipy.stats`, which would double the start-up time.

Every start of a session needs one of the chi-square distribution. For it alone `scipy.special`,
which takes 0.15 s to load, is not needed either: the distribution has a closed form.
"""

import math

import numpy as np


def chi_square_quantile(probability: float, freedom: int) -> float:
    """Quantile of the chi-square distribution with ``freedom`` degrees of freedom.

    The probability to exceed ``2 h`` is the sum of ``exp(-h) h^i / Gamma(i + 1)`` over i = 0, 1,
    ... below half the freedom, or over 1/2, 3/2, ... with ``erfc(sqrt(h))`` if the freedom is odd
    (Abramowitz and Stegun, 26.4.4 and 26.4.5). It is solved for ``h`` by bisection.
    """
    powers = np.arange(0.5 * (freedom % 2), 0.5 * freedom)
    log_gammas = np.array([math.lgamma(power + 1.0) for power in powers.tolist()])

    def exceeds(half: float) -> bool:
        above = float(np.exp(powers * math.log(half) - half - log_gammas).sum())
        above += math.erfc(math.sqrt(half)) if freedom % 2 else 0.0
        return 1.0 - above > probability

    low, high = 0.0, float(freedom)
    while not exceeds(high):
        low, high = high, 2.0 * high
    while low < (middle := 0.5 * (low + high)) < high:
        low, high = (low, middle) if exceeds(middle) else (middle, high)
    return low + high


def f_quantile(probability: float, numerator: int, denominator: int) -> float:
    """Quantile of the F distribution with these degrees of freedom."""
    from scipy.special import fdtri

    return float(fdtri(numerator, denominator, probability))


def student_quantile(probability: float, freedom: int) -> float:
    """Quantile of Student's t distribution with ``freedom`` degrees of freedom."""
    from scipy.special import stdtrit

    return float(stdtrit(freedom, probability))
