"""The spring of a haptic device: its forces, and the bound that it refuses to exceed."""

from dataclasses import replace

import numpy as np
import pytest

from app.fixture import PassivityError
from app.geometry import InputError
from app.simulation import HapticCoupling, HapticParameters

GIVEN = HapticParameters(
    stiffness_n_m=100.0, force_n=3.0, scale=0.5, period_s=0.002, delay_s=0.005, damping_n_s_m=0.2
)


def test_spring_is_relaxed_where_it_is_coupled_and_pulls_both_ends():
    coupling = HapticCoupling(GIVEN)
    handle, tool = np.array([10.0, 20.0, 30.0]), np.array([-5.0, 0.0, 200.0])
    for force in coupling.update(handle, tool):
        assert np.array_equal(force, np.zeros(3))
    on_tool, on_handle = coupling.update(
        handle + np.array([8.0, 0.0, 0.0]), tool + np.array([0.0, 1.0, 0.0])
    )
    np.testing.assert_allclose(on_tool, [0.4, -0.1, 0.0])
    np.testing.assert_allclose(on_handle, [-0.2, 0.05, 0.0])
    assert coupling.is_coupled
    coupling.release()
    assert not coupling.is_coupled
    on_tool, _ = coupling.update(handle + np.array([50.0, 0.0, 0.0]), tool)
    assert np.array_equal(on_tool, np.zeros(3))


def test_force_is_limited():
    coupling = HapticCoupling(GIVEN)
    coupling.update(np.zeros(3), np.zeros(3))
    on_tool, on_handle = coupling.update(np.array([3000.0, 4000.0, 0.0]), np.zeros(3))
    np.testing.assert_allclose(on_tool, [1.8, 2.4, 0.0])
    np.testing.assert_allclose(on_handle, [-0.9, -1.2, 0.0])


def test_bound_is_that_of_a_sampled_spring_with_delay():
    bound = 0.2 / (0.5**2 * (0.001 + 0.005))
    assert GIVEN.max_stiffness_n_m == pytest.approx(bound)
    replace(GIVEN, stiffness_n_m=0.999 * bound)
    with pytest.raises(PassivityError, match=r"is 133.3; expected below 133.3 for its damping"):
        replace(GIVEN, stiffness_n_m=bound)
    assert GIVEN.max_period_s == pytest.approx(0.006)
    replace(GIVEN, period_s=0.999 * GIVEN.max_period_s)
    with pytest.raises(PassivityError):
        replace(GIVEN, period_s=1.001 * GIVEN.max_period_s)


@pytest.mark.parametrize("name", ["stiffness_n_m", "force_n", "scale", "period_s", "damping_n_s_m"])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_values_that_are_not_above_0_are_refused(name, value):
    with pytest.raises(InputError, match=f"{name} of the haptic device is .*; expected more than"):
        replace(GIVEN, **{name: value})
