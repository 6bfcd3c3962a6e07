"""The polynomial in a moving window against scipy."""

import numpy as np
import pytest
from scipy.signal import savgol_filter

from app.analysis.savitzky_golay import savitzky_golay


@pytest.mark.parametrize("derivative", [0, 1, 2, 3])
@pytest.mark.parametrize(("count", "length"), [(40, 11), (11, 11), (8, 5)])
def test_equals_scipy_at_the_ends_too(count: int, length: int, derivative: int) -> None:
    values = np.random.default_rng(count).normal(size=(count, 3)).cumsum(axis=0)
    found = savitzky_golay(values, length, 3, derivative=derivative, step=0.02)
    expected = savgol_filter(values, length, 3, deriv=derivative, delta=0.02, axis=0)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def test_a_cubic_keeps_its_values_and_derivatives() -> None:
    times = 0.02 * np.arange(30)[:, None]
    for derivative, expected in enumerate(
        (2 * times**3 - times, 6 * times**2 - 1, 12 * times, 12 + 0 * times)
    ):
        found = savitzky_golay(2 * times**3 - times, 9, 3, derivative=derivative, step=0.02)
        np.testing.assert_allclose(found, expected, atol=1e-8)
