"""The mesh of the cautery, and its file."""

import numpy as np
import pytest
import trimesh

from app.synthetic import TIP_FRAME, tool_mesh
from app.synthetic.tumour_and_tool import write_stl


def test_the_cautery_is_one_closed_surface():
    mesh = tool_mesh().require_closed("cautery")
    body = trimesh.Trimesh(mesh.vertices_mm, mesh.faces, process=False)
    assert mesh.frame == TIP_FRAME
    assert body.is_watertight and body.euler_number == 2 and body.body_count == 1
    assert 1500 < len(mesh.faces) < 2500


def test_tip_is_the_foremost_point_and_the_origin():
    vertices = tool_mesh().vertices_mm
    assert (vertices[:, 2] == 0.0).sum() == 1
    np.testing.assert_array_equal(vertices[vertices[:, 2].argmax()], 0.0)
    assert vertices[:, 2].min() < -100.0


def test_the_blade_is_flat_and_the_shaft_is_round():
    vertices = tool_mesh().vertices_mm
    blade = vertices[(vertices[:, 2] < -2.0) & (vertices[:, 2] > -14.0)]
    shaft = vertices[(vertices[:, 2] < -18.0) & (vertices[:, 2] > -62.0)]
    assert np.ptp(blade[:, 0]) > 2.5 * np.ptp(blade[:, 1])
    np.testing.assert_allclose(np.hypot(shaft[:, 0], shaft[:, 1]), 1.4, atol=1e-9)


@pytest.fixture
def written(tmp_path):
    write_stl(tmp_path / "tool.stl", tool_mesh())
    return tmp_path / "tool.stl"


def test_trimesh_reads_the_same_surface(written):
    read, mesh = trimesh.load_mesh(written, process=False), tool_mesh()
    np.testing.assert_allclose(read.triangles, mesh.triangles_mm, atol=1e-5)
    read.merge_vertices()
    assert read.is_watertight
    assert read.volume == pytest.approx(mesh.signed_volume_mm3, rel=1e-5)


def test_a_triangle_takes_fifty_bytes(written):
    assert written.stat().st_size == 84 + 50 * len(tool_mesh().faces)
