import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from app.geometry.rotation_vectors import (
    canonical_quaternion,
    rotation_of_vector,
    vector_of_rotation,
)


def vectors():
    random = np.random.default_rng(1)
    made = random.normal(size=(300, 3))
    made /= np.linalg.norm(made, axis=1, keepdims=True)
    angles = [*10.0 ** random.uniform(-9.0, 0.0, 150), *random.uniform(0.0, math.pi, 150)]
    return [*(made * np.array(angles)[:, None]), np.zeros(3), np.array([0.0, math.pi, 0.0])]


@pytest.mark.parametrize("vector", vectors())
def test_rotations_agree_with_scipy(vector):
    expected = Rotation.from_rotvec(vector)
    found = rotation_of_vector(vector)
    np.testing.assert_allclose(found, expected.as_matrix(), rtol=0.0, atol=1e-15)
    back = Rotation.from_matrix(found, assume_valid=True)
    np.testing.assert_allclose(vector_of_rotation(found), back.as_rotvec(), rtol=1e-14, atol=1e-15)
    quaternion = canonical_quaternion(found)
    np.testing.assert_allclose(quaternion, back.as_quat(canonical=True), rtol=0.0, atol=1e-15)
