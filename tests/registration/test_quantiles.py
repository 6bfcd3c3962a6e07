"""Quantiles against scipy.stats."""

import pytest
from scipy.stats import chi2
from scipy.stats import f as fisher
from scipy.stats import t as student

from app.registration.quantiles import chi_square_quantile, f_quantile, student_quantile


@pytest.mark.parametrize("probability", [0.001, 0.05, 0.5, 0.975, 0.99999])
@pytest.mark.parametrize("freedom", [1, 3, 17, 4000])
def test_quantiles_agree_with_scipy_stats(probability: float, freedom: int) -> None:
    chi_square = chi_square_quantile(probability, freedom)
    assert chi_square == pytest.approx(chi2.ppf(probability, freedom), rel=1e-10)
    assert student_quantile(probability, freedom) == pytest.approx(
        student.ppf(probability, freedom), rel=1e-9, abs=1e-12
    )
    for denominator in (2, 12, 200):
        assert f_quantile(probability, freedom, denominator) == pytest.approx(
            fisher.ppf(probability, freedom, denominator), rel=1e-9
        )
