import numpy as np
import pytest
import trimesh

from app.dicom.contours import contours_at, pixels_inside, signed_area_mm2, with_keyholes
from app.geometry import SurfaceMesh
from tests.dicom.surfaces import ball, shell


def box() -> SurfaceMesh:
    mesh = trimesh.creation.box(extents=[4.0, 6.0, 8.0])
    return SurfaceMesh("tumor", mesh.vertices, mesh.faces)


def test_a_box_has_one_contour_of_its_area_and_direction():
    (contour,) = contours_at(box(), 1.0)
    assert signed_area_mm2(contour) == pytest.approx(24.0)
    assert np.abs(contour).max(axis=0).tolist() == [2.0, 3.0]


def test_a_plane_through_vertices_counts_them_as_above():
    assert contours_at(box(), -4.0) == ()
    (contour,) = contours_at(box(), 4.0)
    assert signed_area_mm2(contour) == pytest.approx(24.0)
    assert contours_at(box(), 4.001) == ()


def test_contours_agree_with_those_of_trimesh_at_many_heights():
    generator = np.random.default_rng(5)
    blob = trimesh.creation.icosphere(subdivisions=3)
    scale = 8.0 + generator.normal(0.0, 0.3, len(blob.vertices))
    surface = SurfaceMesh("tumor", blob.vertices * scale[:, None], blob.faces)
    peer = trimesh.Trimesh(surface.vertices_mm, surface.faces, process=False)
    for height in np.linspace(-7.0, 7.0, 15):
        section = peer.section(plane_origin=[0.0, 0.0, height], plane_normal=[0.0, 0.0, 1.0])
        area = abs(section.to_2D()[0].area)
        found = contours_at(surface, float(height))
        assert sum(map(signed_area_mm2, found)) == pytest.approx(area, rel=1e-6)


def test_contours_of_a_hollow_are_clockwise_and_joined_by_a_channel():
    contours = contours_at(shell(10.0, 6.0, (1.0, 2.0, 3.0)), 3.1)
    areas = sorted(map(signed_area_mm2, contours))
    assert [area > 0.0 for area in areas] == [False, True, True]
    joined = with_keyholes(contours)
    assert len(joined) == 2  # the shell with its hole, and the core
    assert sum(map(signed_area_mm2, joined)) == pytest.approx(sum(areas))
    assert all(signed_area_mm2(each) > 0.0 for each in joined)


def test_pixels_of_contours_with_a_channel_are_those_without_it():
    contours = contours_at(shell(10.0, 6.0, (1.0, 2.0, 3.0)), 3.1)
    xs, ys = np.arange(-12.0, 14.0, 0.37), np.arange(-11.0, 15.0, 0.41)
    inside = pixels_inside(contours, xs, ys)
    assert np.array_equal(pixels_inside(with_keyholes(contours), xs, ys), inside)
    radius = np.hypot(xs - 1.0, (ys - 2.0)[:, None])
    sure = (np.abs(radius - 10.0) > 0.1) & (np.abs(radius - 6.0) > 0.1) & (abs(radius - 3.0) > 0.1)
    expected = (radius < 3.0) | ((radius > 6.0) & (radius < 10.0))
    assert np.array_equal(inside[sure], expected[sure])


def test_parts_that_do_not_touch_have_a_contour_each():
    first, second = ball(3.0, (0.0, 0.0, 0.0)), ball(2.0, (10.0, 0.0, 0.0))
    both = SurfaceMesh(
        "tumor",
        np.concatenate([first.vertices_mm, second.vertices_mm]),
        np.concatenate([first.faces, second.faces + len(first.vertices_mm)]),
    )
    assert len(contours_at(both, 0.5)) == 2
