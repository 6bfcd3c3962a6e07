"""Coverage of the 95 % region of a registration by dwells, with errors correlated over time."""

import numpy as np
import pytest

from tests.registration.points.touched_recordings import squared_errors

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("kind", ["80 ms", "anisotropic"])
def test_region_holds_the_error_in_a_few_recordings(kind):
    """50 recordings show a coverage of 0.95 within 0.06."""
    found = np.array([squared_errors(kind, seed, (4, 8)) for seed in range(50)])
    assert (found <= 1.0).mean(axis=0).min() >= 0.88
