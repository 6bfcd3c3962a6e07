import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from app.case.tumor import surface_around
from app.case.tumor.surfaces import CLEARANCE_MM
from app.fixture.meshes.mesh_checks import require_sound
from app.geometry import FloatArray, MeshError, SurfaceMesh
from tests.oracles.winding_number import depths_mm
from tests.refusals import refused

pytestmark = pytest.mark.slow

BALL_MM3 = 4.0 / 3.0 * np.pi


def on_ellipsoid(count: int, axes: tuple[float, float, float], seed: int) -> FloatArray:
    directions = np.random.default_rng(seed).normal(size=(count, 3))
    return directions / np.linalg.norm(directions, axis=1, keepdims=True) * axes


@settings(max_examples=5)
@given(
    count=st.integers(4, 40),
    seed=st.integers(0, 10_000),
    axes=st.tuples(*[st.floats(3.0, 40.0)] * 3),
    scattered=st.booleans(),
)
def test_every_point_is_inside_a_sound_surface(count, seed, axes, scattered):
    random = np.random.default_rng(seed)
    points = random.normal(size=(count, 3)) * axes if scattered else on_ellipsoid(count, axes, seed)
    points = points + random.uniform(-300.0, 300.0, 3)
    try:
        mesh = surface_around(points, "tumor")
    except MeshError as error:
        assert "thick, nearly in one plane" in str(error)
        return
    assert mesh.frame == "tumor"
    require_sound(mesh, "the tumour")
    assert depths_mm(mesh, points).min() > 0.0
    # Points of the hull between the given ones are inside too, up to the angular resolution.
    inner = random.dirichlet(np.ones(count), 100) @ points
    assert depths_mm(mesh, inner).min() > -1e-3
    assert mesh.signed_volume_mm3 >= 0.999 * ConvexHull(points).volume


def test_points_in_single_precision_stay_inside():
    points = np.add(on_ellipsoid(30, (15.0, 12.0, 10.0), 3), [400.0, -300.0, 500.0])
    mesh = surface_around(points, "tumor")
    written = SurfaceMesh("tumor", mesh.vertices_mm.astype(np.float32), mesh.faces)
    assert depths_mm(written, points).min() > 0.0
    assert depths_mm(mesh, points).min() < 2.0 * CLEARANCE_MM


@pytest.mark.parametrize("axes", [(10.0, 10.0, 10.0), (20.0, 8.0, 6.0)])
def test_forty_points_recover_an_ellipsoid(axes):
    pytest.importorskip("vtk")
    from tests.oracles.lumpnav_tumor import lumpnav_volume_mm3

    true_mm3 = BALL_MM3 * float(np.prod(axes))
    ratios, lumpnav_ratios = [], []
    for seed in range(2):
        points = on_ellipsoid(40, axes, seed)
        mesh = surface_around(points, "tumor")
        ratios.append(mesh.signed_volume_mm3 / true_mm3)
        lumpnav_ratios.append(lumpnav_volume_mm3(points) / true_mm3)
        off = np.linalg.norm(mesh.vertices_mm / axes, axis=1)
        assert off.min() > 0.85 and off.max() < 1.1
    assert min(ratios) > 0.97 and max(ratios) < 1.01
    assert min(ratios) > max(lumpnav_ratios)


def test_a_hollow_is_filled():
    points = on_ellipsoid(200, (10.0, 10.0, 10.0), 0)
    dented = points[points[:, 2] < 4.0]
    dented = np.vstack([dented, [[0.0, 0.0, -2.0]]])
    mesh = surface_around(dented, "tumor")
    assert depths_mm(mesh, np.array([[0.0, 0.0, 2.0]]))[0] > 1.0


def test_the_same_points_elsewhere_give_the_same_shape():
    points = on_ellipsoid(25, (15.0, 9.0, 7.0), 1)
    twice = surface_around(np.vstack([points, points]), "tumor")
    shift = np.array([50.0, 0.0, -90.0])
    moved = surface_around(points[::-1] + shift, "tumor")
    np.testing.assert_allclose(moved.vertices_mm - shift, twice.vertices_mm, atol=1e-6)


GOOD = on_ellipsoid(12, (10.0, 9.0, 8.0), 0)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (GOOD[:3], r"3 contoured points, 3 of them distinct; expected 4 to 2000 distinct points"),
        (np.repeat(GOOD[:2], 4, axis=0), r"8 contoured points, 2 of them distinct"),
        (GOOD * [1.0, 1.0, 0.0], r"nearly in one plane"),
        (GOOD * [1.0, 0.0, 0.0] + [0.0, 1.0, 2.0], r"nearly in one plane"),
        (GOOD * [1.0, 1.0, 1e-3], r"mm thick, nearly in one plane"),
        (np.vstack([GOOD, [np.nan, 0.0, 0.0]]), r"contoured point 13 is \[nan, 0.0, 0.0\]"),
        (GOOD * 1e-3, r"span 0\.0\d+ mm; expected 0.5 to 1000 mm \(check the unit"),
        (np.vstack([GOOD, [3e6, 0.0, 0.0]]), r"span 3\.00001e\+06 mm; .*stray"),
        (np.vstack([[300.0, 0.0, 0.0], GOOD]), r"contoured point 1 at \[300.0, 0.0, 0.0\] mm is"),
        (GOOD[:, :2], r"shape \(12, 2\); expected \(n, 3\)"),
        (np.random.default_rng(0).normal(size=(2001, 3)), r"2001 contoured points"),
    ],
)
def test_invalid_points_are_refused(points, message):
    with refused(message, MeshError):
        surface_around(points, "tumor")
