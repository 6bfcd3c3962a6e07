"""Quantiles, from scipy's special functions: loading scipy.stats would double the time to start."""

from scipy.special import fdtri, gammaincinv, stdtrit


def chi_square_quantile(probability: float, freedom: int) -> float:
    """Below it lies a chi-square variable of ``freedom`` degrees, with this probability."""
    return 2.0 * float(gammaincinv(0.5 * freedom, probability))


def f_quantile(probability: float, freedom: int, among: int) -> float:
    """Below it lies Fisher's F of ``freedom`` over ``among`` degrees, with this probability."""
    return float(fdtri(freedom, among, probability))


def student_quantile(probability: float, freedom: int) -> float:
    """Below it lies Student's t of ``freedom`` degrees, with this probability."""
    return float(stdtrit(freedom, probability))
