"""Place of a breach on the tumour and on the tool."""

import numpy as np
import pytest
import trimesh

from app.geometry import InputError, SurfaceMesh, anatomical_words
from app.session import checked_axes, is_tip, place_letters

CENTRE_MM = np.array([10.0, 0.0, -3.0])
FLIPPED = np.diag([-1.0, -1.0, 1.0])
"""The tumour's axes are left, posterior and superior."""


@pytest.mark.parametrize(
    ("direction", "axes", "words"),
    [
        ((1.0, 0.0, 0.0), None, "right"),
        ((0.1, -2.0, 1.2), None, "posterior superior"),
        ((1.0, 0.0, 0.0), FLIPPED, "left"),
        ((0.0, -2.0, 1.2), FLIPPED, "anterior superior"),
        ((0.0, 0.0, 0.0), None, ""),
        ((np.nan, 0.0, 0.0), None, ""),
    ],
)
def test_place_is_named_by_the_axes(direction, axes, words):
    assert anatomical_words(place_letters(np.array(direction), axes)) == words


@pytest.mark.parametrize("matrix", [np.eye(4), np.diag([1.0, 1.0, -1.0]), 2.0 * np.eye(3)])
def test_axes_that_are_no_rotation_are_refused(matrix):
    with pytest.raises(InputError, match="expected"):
        checked_axes(matrix)


def test_tip_ends_2_mm_behind_its_point():
    assert is_tip(2.0) and not is_tip(2.01)


def test_centre_of_a_surface_does_not_depend_on_its_triangles():
    box = trimesh.creation.box((4.0, 6.0, 8.0))
    fine = box.subdivide(np.flatnonzero(box.face_normals[:, 0] > 0.5))
    for mesh in (box, fine):
        surface = SurfaceMesh("tumor", mesh.vertices + CENTRE_MM, mesh.faces)
        np.testing.assert_allclose(surface.centroid_mm, CENTRE_MM, atol=1e-12)
