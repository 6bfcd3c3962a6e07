"""Merging of duplicate vertices against numpy."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from app.geometry import weld_vertices

COORDINATES = st.sampled_from([-1.5, -0.0, 0.0, 1e-300, 2.0])


@given(
    st.integers(1, 30).flatmap(lambda count: arrays(np.float64, (count, 3), elements=COORDINATES))
)
def test_vertices_agree_with_numpy_unique_and_faces_keep_their_corners(vertices):
    faces = np.random.default_rng(len(vertices)).integers(len(vertices), size=(40, 3))
    distinct, merged, kept = weld_vertices(vertices, faces)
    np.testing.assert_array_equal(distinct, np.unique(vertices + 0.0, axis=0))
    assert [len({tuple(corner) for corner in vertices[face] + 0.0}) == 3 for face in faces] == [
        *kept
    ]
    np.testing.assert_array_equal(distinct[merged], vertices[faces[kept]])
    assert merged.shape == (kept.sum(), 3)
