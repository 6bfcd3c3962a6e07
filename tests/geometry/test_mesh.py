"""Surface meshes: validation, volume, closedness; merging of duplicate vertices against numpy."""

import numpy as np
import pytest
import trimesh
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from app.geometry import FrameError, MeshError, SurfaceMesh, Transform, weld_vertices
from tests.geometry.few_examples import given


def sphere(radius: float = 10.0) -> SurfaceMesh:
    made = trimesh.creation.icosphere(subdivisions=3, radius=radius)
    return SurfaceMesh("tumor", made.vertices, made.faces)


def test_volume_and_bounds_agree_with_trimesh():
    mesh = sphere()
    peer = trimesh.Trimesh(mesh.vertices_mm, mesh.faces)
    assert mesh.open_edges() == 0
    assert mesh.signed_volume_mm3 == pytest.approx(peer.volume)
    assert mesh.require_closed("tumour") is mesh
    np.testing.assert_array_equal(mesh.bounds_mm, peer.bounds)


def test_volume_is_accurate_far_from_the_origin():
    mesh = sphere(1.0)
    far = mesh.transformed(Transform("ras", "tumor", np.eye(3), [1e6, -1e6, 1e6]))
    assert far.frame == "ras"
    assert far.signed_volume_mm3 == pytest.approx(mesh.signed_volume_mm3, rel=1e-6)


def test_open_and_inverted_surfaces_are_rejected_with_their_name():
    mesh = sphere()
    with_hole = SurfaceMesh("tumor", mesh.vertices_mm, mesh.faces[1:])
    assert with_hole.open_edges() == 3
    with pytest.raises(MeshError, match="the tumour is not closed: 3 edges"):
        with_hole.require_closed("the tumour")
    with pytest.raises(MeshError, match="encloses -"):
        SurfaceMesh("tumor", mesh.vertices_mm, mesh.faces[:, ::-1]).require_closed("the tumour")
    flipped = mesh.faces.copy()
    flipped[0] = flipped[0, ::-1]
    assert SurfaceMesh("tumor", mesh.vertices_mm, flipped).open_edges() > 0


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        (
            *(np.zeros((0, 3)), [[0, 1, 2]]),
            r"vertices of the mesh in 'tumor' have shape \(0, 3\); expected \(n, 3\) with n > 0",
        ),
        (np.zeros((3, 2)), [[0, 1, 2]], r"shape \(3, 2\)"),
        (np.eye(3), np.zeros((0, 3), int), r"faces of the mesh in 'tumor' have shape \(0, 3\)"),
        (np.eye(3), [[0, 1, 3]], "span 0 to 3; expected integers from 0 to 2"),
        (np.eye(3), [[0, 1, -1]], "span -1 to 1"),
        (np.eye(3), [[0.0, 1.0, 2.0]], "expected integers"),
        (
            *([[0, 0, 0], [1, np.nan, 0], [0, 1, 0]], [[0, 1, 2]]),
            r"vertex 1 of the mesh in 'tumor' is \[.*nan.*\]; expected finite numbers \(1 of 3",
        ),
    ],
)
def test_invalid_arrays_are_rejected(vertices, faces, message):
    with pytest.raises(MeshError, match=message) as caught:
        SurfaceMesh("tumor", np.asarray(vertices, float), np.asarray(faces))
    assert "\n" not in str(caught.value)


def test_transform_from_another_frame_is_rejected():
    with pytest.raises(FrameError, match="'tumor' cannot be transformed by a_from_b"):
        sphere().transformed(Transform.identity("a", "b"))


def test_arrays_are_read_only():
    mesh = sphere()
    with pytest.raises(ValueError, match="read-only"):
        mesh.vertices_mm[0, 0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        mesh.faces[0, 0] = 1


COORDINATES = st.sampled_from([-1.5, -0.0, 0.0, 1e-300, 2.0])


@given(
    st.integers(1, 30).flatmap(lambda count: arrays(np.float64, (count, 3), elements=COORDINATES))
)
def test_vertices_agree_with_numpy_unique_and_faces_keep_their_corners(vertices):
    faces = np.random.default_rng(len(vertices)).integers(len(vertices), size=(40, 3))
    distinct, merged, kept = weld_vertices(vertices, faces)
    np.testing.assert_array_equal(distinct, np.unique(vertices + 0.0, axis=0))
    corners = ({tuple(corner) for corner in vertices[face] + 0.0} for face in faces)
    assert [len(each) == 3 for each in corners] == [*kept]
    np.testing.assert_array_equal(distinct[merged], vertices[faces[kept]])
    assert merged.shape == (kept.sum(), 3)
