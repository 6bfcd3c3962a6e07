"""The page of a needle plan, and the section of a surface."""

import numpy as np
import pytest
import trimesh

from app.geometry import SurfaceMesh
from app.planning import EntryRegion, Needle, NeedleTarget, plan_needle
from app.report.needle_page import _section, needle_page

pytestmark = pytest.mark.slow

BALL = trimesh.creation.icosphere(4, 10.0)
MESH = SurfaceMesh("ct", BALL.vertices, BALL.faces)


def test_section_of_a_ball_is_a_circle():
    aside, down = np.array([0.6, 0.8, 0.0]), np.array([0.0, 0.0, -1.0])
    # 6 mm off the centre, where the circle has a radius of 8 mm.
    origin = 6.0 * np.cross(aside, down) + 3.0 * aside
    lines = _section(MESH, origin, aside, down)
    radii = np.linalg.norm(lines + np.array([3.0, 0.0]), axis=2)
    assert radii == pytest.approx(np.full_like(radii, 8.0), abs=0.05)
    length = np.linalg.norm(lines[:, 0] - lines[:, 1], axis=1).sum()
    assert length == pytest.approx(2.0 * np.pi * 8.0, rel=0.01)


def test_page_of_a_plan_without_structures_escapes_its_texts():
    plan = plan_needle(
        EntryRegion.of_disc("ct", [0, 0, 60], [0, 0, 1], 40.0, count=500),
        NeedleTarget.of_points("ct", [[0.0, 0.0, 0.0]]),
        Needle(100.0, 1.2, 1.0),
        [],
        error=1.0,
        k_sigma=2.0,
    )
    page = needle_page(plan, MESH, [], {"case": "<b>", "target": "tumor", "needle": {"a": 1.0}})
    assert "&lt;b&gt;: needle to tumor" in page
    assert page.count("data:image/png;base64,") == 2
