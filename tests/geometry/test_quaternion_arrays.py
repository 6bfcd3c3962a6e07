import math

import numpy as np
from scipy.spatial.transform import Rotation

from app.geometry import (
    quaternion_of_rotation,
    quaternions_of_rotations,
    rotation_of_quaternion,
    rotations_of_quaternions,
)

_HALF_TURNS = [np.diag(signs) for signs in ([1, -1, -1], [-1, 1, -1], [-1, -1, 1], [1, 1, 1])]


def test_arrays_have_the_bits_of_single_rotations():
    random = Rotation.random(2000, random_state=1).as_matrix()
    flipped = [half @ turn for half in _HALF_TURNS for turn in random[:50]]
    rotations = np.concatenate([random, flipped, _HALF_TURNS])
    quaternions = quaternions_of_rotations(rotations)
    assert quaternions.tolist() == [list(quaternion_of_rotation(each)) for each in rotations]
    assert (quaternions[:, 3] >= 0.0).all()
    norms = [math.hypot(*each) for each in quaternions.tolist()]
    expected = [rotation_of_quaternion(*each) for each in quaternions.tolist()]
    unit = quaternions / np.array(norms)[:, None]
    np.testing.assert_array_equal(rotations_of_quaternions(unit), expected)
