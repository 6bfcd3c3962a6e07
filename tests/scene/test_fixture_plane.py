import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from slicer import vtkMRMLScene

from app.fixture import Constraint
from app.scene import Batch, FixturePlane
from app.scene.convert import vtk_matrix
from tests.scene.conftest import posed

pytestmark = pytest.mark.slow

RAS_FROM_TUMOR = posed("ras", "tumor", [0.4, -1.0, 2.0], [30.0, -4.0, 12.0])


def constraint(normal, offset_mm, point_mm):
    return Constraint(
        frame="tumor",
        normals=np.array([normal, -normal]),
        offsets_mm=np.array([offset_mm, -99.0]),
        points_on_tool_mm=np.array([point_mm, point_mm]),
        tumor_velocities_mm_s=np.zeros((2, 3)),
        hold=False,
    )


@pytest.fixture(scope="module")
def plane():
    scene = vtkMRMLScene()
    pose = scene.AddNewNodeByClass("vtkMRMLLinearTransformNode", "TumorToRas")
    pose.SetMatrixTransformToParent(vtk_matrix(RAS_FROM_TUMOR))
    return FixturePlane(scene, Batch(scene), pose)


@given(seed=st.integers(0, 2**16), offset_mm=st.floats(-50.0, 50.0))
def test_plane_is_the_governing_half_space(plane, seed, offset_mm):
    rng = np.random.default_rng(seed)
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    point_mm = rng.normal(scale=30.0, size=3)
    plane.show(constraint(normal, offset_mm, point_mm))
    assert plane.node.GetDisplayNode().GetVisibility()
    center, up = np.zeros(3), np.zeros(3)
    plane.node.GetCenter(center)
    plane.node.GetNormal(up)
    np.testing.assert_allclose(up, normal, atol=1e-9)
    # On the plane n . x = offset, straight below the tool's point.
    assert normal @ center == pytest.approx(offset_mm, abs=1e-6)
    np.testing.assert_allclose(np.cross(point_mm - center, normal), 0.0, atol=1e-6)
    plane.node.GetCenterWorld(center)
    height = normal @ point_mm - offset_mm
    np.testing.assert_allclose(center, RAS_FROM_TUMOR.apply(point_mm - height * normal), atol=1e-6)


def test_plane_does_not_spin_about_its_normal(plane):
    last = None
    for angle in np.linspace(0.0, 2.0 * np.pi, 90):
        normal = np.array([np.cos(angle), np.sin(angle), 0.3])
        plane.show(constraint(normal / np.linalg.norm(normal), 3.0, 20.0 * normal))
        axes = [np.zeros(3) for _ in range(3)]
        plane.node.GetAxes(*axes)
        if last is not None:
            assert axes[0] @ last > np.cos(2.0 * np.pi / 89) - 1e-9
        last = axes[0]


def test_no_constraint_hides_the_plane(plane):
    plane.show(constraint(np.array([0.0, 0.0, 1.0]), 0.0, np.zeros(3)))
    plane.show(None)
    assert not plane.node.GetDisplayNode().GetVisibility()
    assert plane.node.GetName() == "FixturePlane"
    assert plane.node.GetLocked()
