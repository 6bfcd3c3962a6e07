import igl
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.ndimage import binary_fill_holes
from scipy.spatial.transform import Rotation

from app.case.tumor import surface_of_labels, surfaces
from app.fixture.meshes.mesh_checks import require_sound
from app.geometry import FloatArray, MeshError
from tests.oracles.voxel_reach import contained_points_mm

TURNED = Rotation.from_rotvec([0.3, -0.5, 0.2]).as_matrix()


def grid(sides: tuple[float, float, float], *, mirrored: bool = False) -> FloatArray:
    """``frame_from_index`` (3, 4) of oblique voxels."""
    signs = [-1.0 if mirrored else 1.0, 1.0, 1.0]
    return np.column_stack([TURNED * sides * signs, [30.0, -40.0, 70.0]])


def centres_mm(shape: tuple[int, ...], frame_from_index: FloatArray) -> FloatArray:
    return (
        np.moveaxis(np.indices(shape), 0, -1) @ frame_from_index[:, :3].T + frame_from_index[:, 3]
    )


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize(
    ("sides", "radius"),
    [
        ((1.0, 1.0, 1.0), 10.0),
        ((0.5, 0.5, 2.0), 10.0),
        ((1.0, 1.0, 3.0), 15.0),
        ((0.8, 0.9, 1.4), 7.0),
    ],
)
def test_surface_of_a_ball_is_accurate_to_a_fraction_of_a_voxel(sides, radius, mirrored):
    frame_from_index = grid(sides, mirrored=mirrored)
    shape = tuple(int(2.0 * radius / side) + 5 for side in sides)
    centres = centres_mm(shape, frame_from_index)
    middle = centres.reshape(-1, 3).mean(axis=0) + np.array([0.13, -0.21, 0.32])
    marked = np.linalg.norm(centres - middle, axis=-1) < radius
    mesh = require_sound(surface_of_labels(marked, frame_from_index, "tumor"), "the tumour")
    off = np.linalg.norm(mesh.vertices_mm - middle, axis=1) - radius
    longest = max(sides)
    assert np.sqrt(np.mean(off**2)) < 0.15 * longest
    assert np.abs(off).max() < 0.6 * longest
    assert abs(off.mean()) < 0.05 * longest
    assert mesh.signed_volume_mm3 == pytest.approx(4.0 / 3.0 * np.pi * radius**3, rel=0.02)


@settings(max_examples=25)
@given(
    shape=st.tuples(*[st.integers(1, 7)] * 3),
    share=st.floats(0.05, 0.95),
    seed=st.integers(0, 10_000),
)
def test_surface_separates_any_marks_from_unmarked_voxels(shape, share, seed):
    marked = np.random.default_rng(seed).random(shape) < share
    if not marked.any():
        return
    marked = binary_fill_holes(marked)
    frame_from_index = grid((0.8, 0.9, 1.6))
    mesh = require_sound(surface_of_labels(marked, frame_from_index, "tumor"), "the tumour")
    # Voxels beyond the array are outside.
    around = np.pad(marked, 1)
    centres = centres_mm(around.shape, frame_from_index) - frame_from_index[:, :3].sum(axis=1)
    vertices, faces = np.array(mesh.vertices_mm), np.array(mesh.faces)
    winding = igl.winding_number(vertices, faces, centres.reshape(-1, 3))
    np.testing.assert_array_equal(winding > 0.5, around.ravel())
    voxel_mm3 = abs(np.linalg.det(frame_from_index[:, :3]))
    assert mesh.signed_volume_mm3 >= 0.999 * marked.sum() * voxel_mm3
    contained = contained_points_mm(marked, frame_from_index)
    assert (igl.winding_number(vertices, faces, contained) > 0.5).all()


def test_surface_follows_the_voxel_faces_at_the_border():
    frame_from_index = np.column_stack([np.diag([0.5, 1.0, 2.0]), [0.0, 0.0, 0.0]])
    mesh = surface_of_labels(np.ones((20, 20, 20), dtype=bool), frame_from_index, "tumor")
    low, high = mesh.bounds_mm
    np.testing.assert_allclose(low / [0.5, 1.0, 2.0], -0.5, atol=0.1)
    np.testing.assert_allclose(high / [0.5, 1.0, 2.0], 19.5, atol=0.1)
    assert mesh.signed_volume_mm3 == pytest.approx(8000.0, rel=0.005)


def test_sheet_of_one_voxel_is_kept():
    marked: NDArray[np.bool_] = np.zeros((12, 12, 5), dtype=bool)
    marked[1:-1, 1:-1, 2] = True
    mesh = require_sound(surface_of_labels(marked, grid((1.0, 1.0, 1.0)), "tumor"), "the sheet")
    assert mesh.signed_volume_mm3 == pytest.approx(100.0, rel=0.05)


UPRIGHT = np.column_stack([np.eye(3), np.zeros(3)])


@pytest.mark.parametrize(
    "sides",
    [(1, 1, 1), (1, 1, 20), (1, 2, 3), (2, 2, 2), (2, 2, 20), (3, 3, 3), (3, 3, 12), (2, 10, 10)],
)
def test_small_and_thin_parts_keep_their_volume(sides):
    mesh = require_sound(surface_of_labels(np.ones(sides, dtype=bool), UPRIGHT, "tumor"), "block")
    assert mesh.signed_volume_mm3 == pytest.approx(np.prod(sides), rel=0.02)
    assert mesh.signed_volume_mm3 >= np.prod(sides)
    assert (np.ptp(mesh.vertices_mm, axis=0) >= np.array(sides) - 1e-4).all()


def ball_and(*boxes: tuple[slice, slice, slice]) -> NDArray[np.bool_]:
    """A ball of radius 7 around (14, 14, 14), with additional voxels."""
    marked = np.linalg.norm(np.moveaxis(np.indices((30, 30, 30)), 0, -1) - 14, axis=-1) < 7.0
    for box in boxes:
        marked[box] = True
    return np.asarray(marked)


@pytest.mark.parametrize("side", [1, 3])
def test_satellite_beside_a_ball_keeps_its_volume(side):
    box = (slice(24, 24 + side), slice(13, 13 + side), slice(13, 13 + side))
    mesh = require_sound(surface_of_labels(ball_and(box), UPRIGHT, "tumor"), "two parts")
    alone = surface_of_labels(np.ones((side,) * 3, dtype=bool), UPRIGHT, "tumor")
    of_satellite = mesh.vertices_mm[:, 0] > 22.5
    np.testing.assert_allclose(
        mesh.vertices_mm[of_satellite] - [24.0, 13.0, 13.0], alone.vertices_mm, atol=1e-6
    )


def test_spike_of_one_voxel_on_a_ball_is_not_thinned():
    spike = (slice(20, 28), slice(14, 15), slice(14, 15))
    mesh = require_sound(surface_of_labels(ball_and(spike), UPRIGHT, "tumor"), "the spike")
    around = np.abs(mesh.vertices_mm[:, 0] - 24.0) < 0.01
    off = np.linalg.norm(mesh.vertices_mm[around][:, 1:] - 14.0, axis=1)
    # The half-diagonal of a square of one voxel's area.
    assert around.sum() == 4 and off.min() > 0.7


@pytest.mark.parametrize(
    ("marked", "max_voxels", "problem"),
    [
        (np.ones((4, 3, 2)), 100, "span 4 x 3 x 2; expected 100 with their border or less"),
        ((np.indices((13, 13, 13)) % 3 == 0).all(axis=0), None,
         "125 parts that do not touch and 125 voxels"),
        (np.random.default_rng(0).random((120, 120, 120)) < 0.5, None,
         "expected up to 64 and 400000"),
        (np.zeros((3, 3, 3)), None, "no voxel is marked"),
    ],
    ids=["large", "islands", "noise", "empty"],
)  # fmt: skip
def test_large_noisy_and_empty_segments_are_refused(monkeypatch, marked, max_voxels, problem):
    if max_voxels is not None:
        monkeypatch.setattr(surfaces, "MAX_VOXELS", max_voxels)
    with pytest.raises(MeshError, match=problem):
        surface_of_labels(marked.astype(bool), grid((1.0, 1.0, 1.0)), "tumor")
