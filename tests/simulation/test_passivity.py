"""Energy that a haptic device gives to a hand: none inside the bound, and some outside of it."""

from dataclasses import replace

import pytest

from app.fixture import PassivityError
from tests.simulation.haptic_touches import (
    COUPLING,
    GUIDANCE,
    ROUNDING_J,
    Device,
    GuidanceTouch,
    SpringTouch,
    touched,
)

pytestmark = pytest.mark.slow

FORCES = pytest.mark.parametrize(
    ("stated", "touch"), [(COUPLING, SpringTouch), (GUIDANCE, GuidanceTouch)]
)


@FORCES
def test_device_gives_out_no_energy_inside_the_bound(stated, touch):
    assert (touched(Device.stated(stated), touch, 10, 3) <= ROUNDING_J).all()


@FORCES
def test_device_outside_the_bound_gives_out_energy_and_is_refused(stated, touch):
    weak = replace(Device.stated(stated), damping_n_s_m=0.1 * stated.damping_n_s_m)
    assert touched(weak, touch, 10, 4).max() > 1e3 * ROUNDING_J
    with pytest.raises(PassivityError):
        replace(stated, damping_n_s_m=weak.damping_n_s_m)


def test_later_forces_than_stated_give_out_energy():
    late = replace(Device.stated(COUPLING), delay_s=0.1)
    assert (touched(late, SpringTouch, 10, 5) > ROUNDING_J).any()
