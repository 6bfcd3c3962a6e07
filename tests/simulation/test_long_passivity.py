"""A thousand touches of a haptic device, none of which gets energy out of it."""

import pytest

from tests.simulation.haptic_touches import (
    COUPLING,
    GUIDANCE,
    ROUNDING_J,
    Device,
    GuidanceTouch,
    SpringTouch,
    touched,
)

pytestmark = [pytest.mark.exhaustive, pytest.mark.timeout(1800)]


@pytest.mark.parametrize(("stated", "touch"), [(COUPLING, SpringTouch), (GUIDANCE, GuidanceTouch)])
def test_device_gives_out_no_energy_inside_the_bound(stated, touch):
    assert (touched(Device.stated(stated), touch, 1000, 1) <= ROUNDING_J).all()
