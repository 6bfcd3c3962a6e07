"""Boxes, cylinders and spheres are closed, oriented outward and of the given size."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.geometry import SurfaceMesh
from app.robot import RobotMeshError
from app.robot.meshes import primitives

sizes = st.floats(1e-3, 1e3)


def surface(shape):
    return SurfaceMesh("link", *shape).require_closed("shape")


@given(sizes, sizes, sizes)
def test_box_has_the_given_size(x, y, z):
    mesh = surface(primitives.box((x, y, z)))
    low, high = mesh.bounds_mm
    np.testing.assert_allclose(high, [x / 2, y / 2, z / 2])
    np.testing.assert_allclose(low, -high)
    assert mesh.signed_volume_mm3 == pytest.approx(x * y * z)


@given(sizes, sizes)
def test_cylinder_is_along_z(radius, length):
    mesh = surface(primitives.cylinder(radius, length))
    low, high = mesh.bounds_mm
    np.testing.assert_allclose(high, [radius, radius, length / 2])
    np.testing.assert_allclose(low, -high)
    assert mesh.signed_volume_mm3 == pytest.approx(math.pi * radius**2 * length, rel=0.003)


@given(sizes)
def test_sphere_has_the_given_radius(radius):
    mesh = surface(primitives.sphere(radius))
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices_mm, axis=1), radius)
    assert mesh.signed_volume_mm3 == pytest.approx(4 / 3 * math.pi * radius**3, rel=0.01)


@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan, math.inf])
def test_size_that_is_not_above_zero_is_refused(bad):
    for make in (
        lambda: primitives.box((1.0, bad, 1.0)),
        lambda: primitives.cylinder(1.0, bad),
        lambda: primitives.sphere(bad),
    ):
        with pytest.raises(RobotMeshError, match="above 0"):
            make()
