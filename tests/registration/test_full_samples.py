"""The statistics of registration over six times the trials that the suite takes."""

import pytest

from tests.fixture.full_samples import sampled_tests
from tests.registration import test_consensus
from tests.registration.points import test_paired
from tests.registration.robot_base import test_robot_world, test_time_offset
from tests.registration.tool import test_pivot, test_pivot_selection, test_spin
from tests.registration.uncertainty import test_drift, test_tre

pytestmark = pytest.mark.exhaustive


@pytest.fixture
def sample():
    return 6


globals().update(
    sampled_tests(
        *(test_consensus, test_paired, test_robot_world, test_time_offset),
        *(test_pivot, test_pivot_selection, test_spin, test_drift, test_tre),
    )
)
