"""Depth of a pressed tool, measured by libigl on MuJoCo's own geometry."""

import pytest

from tests.simulation.pressed_tool import MASSES_KG, MAX_DEPTH_MM, convex_error_mm, run_press

pytestmark = pytest.mark.long


@pytest.mark.parametrize("mass_kg", MASSES_KG)
def test_pressed_tool_stays_on_the_surface(tmp_path, mass_kg):
    found = run_press(tmp_path, mass_kg)
    assert found.pressed_s >= 5.0
    assert 0.0 < found.impact_mm <= MAX_DEPTH_MM
    assert found.contact_mm <= MAX_DEPTH_MM
    assert found.rest_mm <= MAX_DEPTH_MM
    assert found.is_good


def test_parts_differ_little_from_the_skull_and_keep_its_opening():
    outside, uncovered = convex_error_mm()
    assert 0.0 < outside < 5.0, "mm; the hull would fill the shell of 70 mm"
    assert uncovered < 0.1, "mm"
