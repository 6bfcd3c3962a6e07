import numpy as np
import pytest
import trimesh

from app.synthetic import cautery_mesh
from app.synthetic.stl import write_stl


@pytest.fixture
def written(tmp_path):
    write_stl(tmp_path / "tool.stl", cautery_mesh())
    return tmp_path / "tool.stl"


def test_trimesh_reads_the_same_surface(written):
    read, mesh = trimesh.load_mesh(written, process=False), cautery_mesh()
    np.testing.assert_allclose(read.triangles, mesh.triangles_mm, atol=1e-5)
    read.merge_vertices()
    assert read.is_watertight
    assert read.volume == pytest.approx(mesh.signed_volume_mm3, rel=1e-5)


def test_a_triangle_takes_fifty_bytes(written):
    assert written.stat().st_size == 84 + 50 * len(cautery_mesh().faces)
