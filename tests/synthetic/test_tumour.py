from dataclasses import replace

import igl
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from app.synthetic.tumour_and_tool import Tumour, icosphere


@pytest.fixture(scope="module")
def tumour():
    return Tumour.generate(np.random.default_rng(3))


@pytest.fixture(scope="module")
def mesh(tumour):
    return tumour.mesh()


def test_the_mesh_is_closed_and_fine(mesh):
    mesh.require_closed("tumour")
    assert len(mesh.faces) == 20480
    assert mesh.frame == "tumor"


def test_the_mesh_is_irregular(mesh):
    radii = np.linalg.norm(mesh.vertices_mm, axis=1)
    hull = trimesh.Trimesh(mesh.vertices_mm, mesh.faces).convex_hull
    assert radii.max() > 1.3 * radii.min()
    assert mesh.signed_volume_mm3 < 0.99 * hull.volume


def test_the_sign_of_height_agrees_with_the_winding_number_of_the_mesh(tumour, mesh):
    points = np.random.default_rng(4).uniform(-22.0, 22.0, size=(3000, 3))
    height = tumour.height_mm(points)
    clear = np.abs(height) > 0.05  # nearer points differ between facets and surface
    winding = igl.fast_winding_number(mesh.vertices_mm, mesh.faces.astype(np.int64), points)
    assert ((winding > 0.5) == (height < 0.0))[clear].all()
    assert 100 < (height[clear] < 0.0).sum() < 2900


def test_height_is_never_below_the_distance(tumour, mesh):
    points = np.random.default_rng(5).uniform(-30.0, 30.0, size=(500, 3))
    squared, _, _ = igl.point_mesh_squared_distance(
        points, mesh.vertices_mm, mesh.faces.astype(np.int64)
    )
    assert (np.abs(tumour.height_mm(points)) > np.sqrt(squared) - 0.05).all()


def test_the_origin_is_inside(tumour):
    assert tumour.height_mm(np.zeros((1, 3)))[0] < -5.0


@settings(max_examples=15)
@given(st.integers(0, 2**32))
def test_tumours_of_any_seed_have_plausible_sizes(seed):
    grown = Tumour.generate(np.random.default_rng(seed))
    radii = grown.radius_mm(icosphere(3)[0])
    assert radii.min() > 6.0 and radii.max() < 32.0


def test_seeds_give_different_tumours(tumour):
    other = Tumour.generate(np.random.default_rng(6))
    directions = icosphere(2)[0]
    assert np.abs(tumour.radius_mm(directions) - other.radius_mm(directions)).max() > 0.5


@pytest.mark.parametrize("subdivisions", [0, 1, 3])
def test_the_icosphere_covers_the_sphere_once(subdivisions):
    directions, faces = icosphere(subdivisions)
    sphere = trimesh.Trimesh(directions, faces, process=False)
    assert len(faces) == 20 * 4**subdivisions
    assert sphere.is_watertight and sphere.euler_number == 2
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, atol=1e-12)
    assert sphere.volume > 0.0


def test_normals_are_the_gradient_of_the_height():
    """Compared with differences of the height, in more points than one part has."""
    for irregularity in (0.0, 1.0):
        tumour = Tumour.generate(np.random.default_rng(8))
        tumour = replace(tumour, lobe_heights=irregularity * tumour.lobe_heights)
        points = tumour.surface_mm(icosphere(5)[0])
        gradient = np.empty_like(points)
        for axis, step in enumerate(1e-4 * np.eye(3)):
            ahead, behind = tumour.height_mm(points + step), tumour.height_mm(points - step)
            gradient[:, axis] = (ahead - behind) / 2e-4
        gradient /= np.linalg.norm(gradient, axis=1, keepdims=True)
        assert len(points) > 2048
        np.testing.assert_allclose(tumour.normals(points), gradient, atol=1e-7)
