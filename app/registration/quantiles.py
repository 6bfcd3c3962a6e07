"""Quantiles from `scipy.special`: importing `scipy.stats` would double the start-up time."""

from scipy.special import fdtri, gammaincinv, stdtrit


def chi_square_quantile(probability: float, freedom: int) -> float:
    """Quantile of the chi-square distribution with ``freedom`` degrees of freedom."""
    return 2.0 * float(gammaincinv(0.5 * freedom, probability))


def f_quantile(probability: float, numerator: int, denominator: int) -> float:
    """Quantile of the F distribution with these degrees of freedom."""
    return float(fdtri(numerator, denominator, probability))


def student_quantile(probability: float, freedom: int) -> float:
    """Quantile of Student's t distribution with ``freedom`` degrees of freedom."""
    return float(stdtrit(freedom, probability))
