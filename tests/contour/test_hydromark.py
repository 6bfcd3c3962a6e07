"""A marked hydromark: its volume by the formulas of ball and capsule, and what is refused."""

import math
from itertools import pairwise

import numpy as np
import pytest

from app.contour import Change, ContourEditor, contour_surface, hydromark_surface
from app.geometry import MeshError

ME = Change("me", 0)


def volume_mm3(length_mm: float, radius_mm: float) -> float:
    return math.pi * radius_mm**2 * (length_mm + 4.0 / 3.0 * radius_mm)


@pytest.mark.parametrize("radius_mm", [0.5, 2.0])
@pytest.mark.parametrize("dilation_mm", [0.0, 5.0])
@pytest.mark.parametrize("shares", [(0.0,), (0.0, 1.0), (0.0, 0.25, 1.0)])
def test_marked_clip_has_the_volume_of_a_capsule(radius_mm, dilation_mm, shares):
    ends = np.array([[1.0, -2.0, 30.0], [4.0, 2.0, 42.0]])  # 13 mm apart
    points = np.array([ends[0] + share * (ends[1] - ends[0]) for share in shares])
    mesh = hydromark_surface(points, radius_mm, dilation_mm, "needle")
    assert (mesh.frame, mesh.open_edges()) == ("needle", 0)
    expected = volume_mm3(13.0 * (len(shares) > 1), radius_mm + dilation_mm)
    assert expected <= mesh.signed_volume_mm3 <= 1.01 * expected


def test_surface_is_outside_of_the_capsule_by_less_than_a_hundredth_of_its_radius():
    ends = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 10.0]])
    mesh = hydromark_surface(ends, 3.0, 1.0, "needle")
    edges = [mesh.triangles_mm[:, list(pair)] for pair in pairwise((0, 1, 2, 0))]
    middles = np.concatenate([each.mean(axis=1) for each in edges])
    for points in (mesh.vertices_mm, middles, mesh.triangles_mm.mean(axis=1)):
        nearest = points.copy()
        nearest[:, :2], nearest[:, 2] = 0.0, np.clip(points[:, 2], 0.0, 10.0)
        distances_mm = np.linalg.norm(points - nearest, axis=1)
        assert distances_mm.min() >= 4.0 - 1e-9
        assert distances_mm.max() <= 4.0 * 1.02


def test_one_marked_point_becomes_a_contour_with_the_uncertainty_of_its_place():
    editor = ContourEditor("needle")
    editor.add(ME, np.array([1.0, 2.0, 3.0]))
    with pytest.raises(MeshError, match="1 points; expected 4 or more"):
        contour_surface(editor.contour, 0.0)
    seen = Change("me", editor.revision)
    editor.mark_hydromark(seen, 2.0)
    editor.dilate(seen, 1.0)
    made = contour_surface(editor.contour, 0.3)
    assert made.uncertainty is None
    assert made.mesh.signed_volume_mm3 == pytest.approx(volume_mm3(0.0, 3.0), rel=0.01)
    np.testing.assert_allclose(made.mesh.centroid_mm, [1.0, 2.0, 3.0], atol=0.02)
    editor.calibrate(seen, 0.4)
    uncertainty = contour_surface(editor.contour, 0.3).uncertainty
    assert uncertainty is not None
    assert uncertainty.sigma_mm == pytest.approx(0.5)
    editor.undo(seen)
    editor.undo(seen)
    editor.undo(seen)
    assert editor.contour.hydromark_mm == 0.0


@pytest.mark.parametrize(
    ("count", "radius_mm", "expected"),
    [
        (0, 2.0, "hydromark: 0 points; expected 1 to 20"),
        (21, 2.0, "hydromark: 21 points; expected 1 to 20"),
        (1, 0.0, "hydromark: a radius of 0 mm; expected above 0 to 20 mm"),
        (1, 20.5, "hydromark: a radius of 20.5 mm; expected above 0 to 20 mm"),
        (1, math.nan, "hydromark: a radius of nan mm; expected above 0 to 20 mm"),
    ],
)
def test_what_is_no_clip_is_refused_in_one_line(count, radius_mm, expected):
    with pytest.raises(MeshError, match=f"^{expected}$"):
        hydromark_surface(np.arange(3.0 * count).reshape(-1, 3), radius_mm, 0.0, "needle")
