"""The half-axis of an arm that closes the loop itself."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from app.control import ImpedanceParameters, half_axis
from app.fixture import MarginState, PassivityError, PlainConstraint
from app.geometry import InputError, Transform

GIVEN = ImpedanceParameters(
    stiffness_n_m=200.0, damping_n_s_m=1.0, period_s=0.001, arm_damping_n_s_m=2.0
)


def constraint(normals, offsets, points):
    return PlainConstraint(
        "guard", 1, "tumor", 1, 2, int(MarginState.NEGATIVE), False, True, True, normals, offsets,
        points, np.zeros((len(normals), 3)), 0.0, 0.0, 0.0, 2.0, "setup",
    )  # fmt: skip


def test_nearest_plane_is_given_for_the_tip_in_the_base():
    random = np.random.default_rng(3)
    for _ in range(50):
        rotation = Rotation.random(random_state=random).as_matrix()
        rule_from_base = Transform("tumor", "base", rotation, random.uniform(-50, 50, 3))
        tip = random.uniform(-100, 100, 3)
        normals = random.normal(size=(3, 3))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        clearances = random.uniform(0.5, 30.0, 3)
        # The tool's own points are away from its tip, as on the shaft of a tool.
        points = rule_from_base.apply(tip) + random.uniform(-20, 20, (3, 3))
        offsets = np.einsum("ij,ij->i", normals, points) - clearances
        axis = half_axis(constraint(normals, offsets, points), rule_from_base, tip)
        nearest = int(clearances.argmin())
        np.testing.assert_allclose(rotation @ axis.normal, normals[nearest], atol=1e-12)
        assert axis.normal @ (tip - axis.point_mm) == pytest.approx(clearances[nearest])
        np.testing.assert_allclose(axis.rotation[:, 2], axis.normal, atol=1e-12)
        np.testing.assert_allclose(axis.rotation @ axis.rotation.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(axis.rotation) == pytest.approx(1.0)


def test_bound_counts_the_virtual_damping():
    replace(GIVEN, stiffness_n_m=1999.0)
    with pytest.raises(PassivityError, match=r"needs a damping of 2 N s/m .*expected below"):
        replace(GIVEN, stiffness_n_m=2000.0)
    with pytest.raises(PassivityError):
        replace(GIVEN, damping_n_s_m=1.9)
    replace(GIVEN, damping_n_s_m=0.0)


@pytest.mark.parametrize("name", ["stiffness_n_m", "damping_n_s_m", "period_s"])
@pytest.mark.parametrize("value", [-1.0, np.nan, np.inf])
def test_values_out_of_range_are_refused(name, value):
    with pytest.raises(InputError, match=f"{name} of the impedance is .*; expected more than 0"):
        replace(GIVEN, **{name: value})
