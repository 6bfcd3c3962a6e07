import igl
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from app.geometry import Transform
from app.synthetic import TIP_FRAME, TUMOR_FRAME, Clearance, Tumour, tool_mesh
from app.synthetic.truth import dense_surface

pytestmark = pytest.mark.slow


def pose(random, spread_mm):
    rotation = Rotation.random(rng=random).as_matrix()
    return Transform(TUMOR_FRAME, TIP_FRAME, rotation, random.uniform(-spread_mm, spread_mm, 3))


@pytest.fixture(scope="module")
def tumour():
    return Tumour.generate(np.random.default_rng(7))


@pytest.fixture(scope="module")
def clearance(tumour):
    return Clearance(tumour, tool_mesh())


def test_distance_agrees_with_libigl_on_the_meshes(tumour, clearance):
    mesh, tool = tumour.mesh(), tool_mesh()
    near = tool.triangles_mm[(tool.triangles_mm[:, :, 2] > -66.1).all(axis=1)]
    tool_mm = dense_surface(near, 0.8)
    random, distances = np.random.default_rng(8), []
    for _ in range(5):
        tumor_from_tip = pose(random, 20.0)
        points = tumor_from_tip.apply(tool_mm)
        signed, *_ = igl.signed_distance(points, mesh.vertices_mm, mesh.faces.astype(np.int64))
        handle_mm = np.linalg.norm(tumor_from_tip.apply((0.0, 0.0, -98.0)))
        if handle_mm < 70.0:
            continue  # the handle, which has no points here, may be nearest
        distances.append(float(signed.min()))
        assert clearance.distance_mm(tumor_from_tip) == pytest.approx(distances[-1], abs=0.06)
    assert min(distances) < -2.0 and max(distances) > 2.0


def test_height_and_distance_agree_in_sign_and_order(clearance):
    random = np.random.default_rng(9)
    for _ in range(25):
        tumor_from_tip = pose(random, 25.0)
        height = clearance.height_mm(tumor_from_tip)
        distance = clearance.distance_mm(tumor_from_tip)
        assert (height < 0.0) == (distance < 0.0)
        assert clearance.distance_per_height * abs(height) <= abs(distance) + 0.02
        assert abs(distance) <= abs(height) + 0.02


def test_distance_to_a_sphere_is_exact():
    sphere = Tumour(np.full(3, 10.0), np.array([[0.0, 0.0, 1.0]]), np.zeros(1), np.ones(1))
    clearance = Clearance(sphere, tool_mesh())
    points = np.array([[0.0, 0.0, 13.0], [4.0, 0.0, 0.0], [0.0, -30.0, 0.0]])
    np.testing.assert_allclose(clearance.point_distances_mm(points), [3.0, -6.0, 20.0], atol=0.02)
    above = Transform(TUMOR_FRAME, TIP_FRAME, np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, 8.5]))
    assert clearance.distance_mm(above) == pytest.approx(-1.5, abs=0.01)
    beside = Transform(
        TUMOR_FRAME, TIP_FRAME, np.diag([1.0, -1.0, -1.0]), np.array([0.0, 12.0, -30.0])
    )
    assert clearance.distance_mm(beside) == pytest.approx(12.0 - 1.4 - 10.0, abs=0.02)


def test_dense_surface_leaves_no_long_edge_and_keeps_the_corners():
    triangle = np.array([[[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 1.0, 0.0]]])
    points = dense_surface(triangle, 0.3)
    probes = np.random.default_rng(1).dirichlet(np.ones(3), 500) @ triangle[0]
    gaps = np.linalg.norm(probes[:, None] - points[None], axis=2).min(axis=1)
    assert gaps.max() <= 0.3 / np.sqrt(3.0) + 1e-9
    assert all((points == corner).all(axis=1).any() for corner in triangle[0])
    assert (points[:, 2] == 0.0).all() and (points[:, 0] / 3.0 + points[:, 1]).max() <= 1.0 + 1e-12
