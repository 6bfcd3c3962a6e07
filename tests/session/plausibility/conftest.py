import pytest

from app.runtime import prepare_case
from tests.session.plausibility.simulated_motion import SimulatedMotion
from tests.shipped_case import SHIPPED_CASE


@pytest.fixture(scope="module")
def motion():
    return SimulatedMotion(50)


@pytest.fixture(scope="module")
def prepared():
    return prepare_case(SHIPPED_CASE, tip_only=True)
