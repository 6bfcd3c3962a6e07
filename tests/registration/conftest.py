"""Fixtures of the tests of registration."""

import pytest


@pytest.fixture
def sample():
    """Factor on the number of trials; `test_full_samples` sets a larger one."""
    return 1
