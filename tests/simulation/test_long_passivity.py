"""A thousand touches of a haptic device, none of which gets energy out of it."""

import pytest

from tests.simulation.haptic_touches import ROUNDING_J, Device, touched
from tests.simulation.test_passivity import FORCES

pytestmark = [pytest.mark.exhaustive, pytest.mark.timeout(1800)]


@FORCES
def test_device_gives_out_no_energy_inside_the_bound(stated, touch):
    assert (touched(Device.stated(stated), touch, 1000, 1) <= ROUNDING_J).all()
