"""Covariance of a pivot with errors that last 0.4 s; the long form has spins and more kinds."""

import numpy as np
import pytest

from tests.registration.tool.correlated_poses import squared_error

pytestmark = pytest.mark.slow


def test_region_holds_with_errors_that_last():
    """Covariances for independent errors give a mean above 1.3."""
    found = [squared_error("400 ms", seed, spin=False, selected=True) for seed in range(6)]
    assert 0.05 < np.mean(found) < 0.8
    assert np.median(found) < 0.6
