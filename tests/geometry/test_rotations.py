"""Rotation vectors and arrays of quaternions against scipy and single rotations."""

import math

import numpy as np
from scipy.spatial.transform import Rotation

from app.geometry import (
    quaternion_of_rotation,
    quaternions_of_rotations,
    rotation_of_quaternion,
    rotations_of_quaternions,
)
from app.geometry.rotations import canonical_quaternion, rotation_of_vector, vector_of_rotation

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


def test_rotation_vectors_agree_with_scipy():
    random = np.random.default_rng(1)
    made = random.normal(size=(300, 3))
    made /= np.linalg.norm(made, axis=1, keepdims=True)
    angles = [*10.0 ** random.uniform(-9.0, 0.0, 150), *random.uniform(0.0, math.pi, 150)]
    scaled = made * np.array(angles)[:, None]
    for vector in (*scaled, np.zeros(3), np.array([0.0, math.pi, 0.0])):
        found = rotation_of_vector(vector)
        expected = Rotation.from_rotvec(vector).as_matrix()
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-15)
        back = Rotation.from_matrix(found, assume_valid=True)
        again = vector_of_rotation(found)
        np.testing.assert_allclose(again, back.as_rotvec(), rtol=1e-14, atol=1e-15)
        quaternion = canonical_quaternion(found)
        np.testing.assert_allclose(quaternion, back.as_quat(canonical=True), rtol=0.0, atol=1e-15)
