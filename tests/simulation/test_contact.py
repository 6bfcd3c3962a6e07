"""How deep a pressed tool penetrates, measured by libigl on MuJoCo's own geometry."""

import pytest

from benchmarks.closed_loop import contact
from benchmarks.closed_loop.contact import MASSES_KG, MAX_DEPTH_MM, convex_error_mm, run_press

pytestmark = pytest.mark.long


@pytest.fixture(autouse=True)
def coarse_skull(monkeypatch):
    """A skull of a quarter of the triangles, whose convex parts are computed sooner."""
    icosphere = contact.trimesh.creation.icosphere
    monkeypatch.setattr(
        contact.trimesh.creation,
        "icosphere",
        lambda subdivisions=3, **options: icosphere(subdivisions - 1, **options),
    )


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
