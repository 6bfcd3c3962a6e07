"""Surface registration: accuracy, covariance, undetermined surfaces."""

import numpy as np
import pytest
import trimesh
from scipy.stats import chi2

from app.geometry import FrameError
from app.registration import (
    AcceptanceLimits,
    ConvergenceError,
    FreeMotionError,
    NoConsensusError,
    NotFiniteError,
    ShapeError,
    TooFewError,
    predict_tre,
    register_surface,
)
from app.registration.small_motion import motion_between
from tests.registration.surfaces import ASYMMETRIC_SURFACE as SHAPE
from tests.registration.surfaces import mesh_of, touch_surface

pytestmark = pytest.mark.slow

MESH = mesh_of(SHAPE)


def test_noise_free_points_give_the_true_transform():
    rng = np.random.default_rng(1)
    truth, points, start = touch_surface(rng, SHAPE, 60, 0.0)
    result = register_surface(points, MESH, start=start)
    assert result.transform.angle_to(truth) < 1e-5
    assert result.transform.distance_mm_to(truth) < 5e-3
    assert result.accepted and result.method == "surface"


def test_covariance_holds_and_the_error_is_comparable_to_icp(sample):
    rng = np.random.default_rng(2)
    ours, peers, squared, trials = [], [], [], 4 * sample
    for _ in range(trials):
        truth, points, start = touch_surface(rng, SHAPE, 40, 0.3)
        result = register_surface(points, MESH, start=start, noise_mm=0.3)
        options = {"threshold": 1e-7, "max_iterations": 60, "reflection": False, "scale": False}
        peer, _, _ = trimesh.registration.icp(points, SHAPE, initial=start.matrix, **options)
        motion = motion_between(truth, result.transform)
        squared.append(motion @ np.linalg.solve(result.covariance, motion))
        centre = truth.inverse().apply(np.zeros(3))
        ours.append(np.linalg.norm(result.transform.apply(centre)))
        peers.append(np.linalg.norm(peer[:3, :3] @ centre + peer[:3, 3]))
    low, high = chi2.ppf([0.0005, 0.9995], 6 * trials) / trials
    assert low < np.mean(squared) < 1.3 * high, "curvature of the surface is not in the first order"
    assert np.mean(ours) < 1.15 * np.mean(peers)


def test_points_off_the_surface_are_rejected():
    rng = np.random.default_rng(3)
    truth, points, start = touch_surface(rng, SHAPE, 50, 0.2)
    points[[4, 17, 33]] += truth.inverse().rotate([[0, 0, 15.0], [12.0, 0, 0], [0, 14.0, 0]])
    result = register_surface(points, MESH, start=start, inlier_mm=1.5)
    far = np.flatnonzero(
        np.abs(trimesh.proximity.signed_distance(SHAPE, truth.apply(points))) > 1.5
    )
    assert result.outliers == tuple(far) and len(far) >= 2
    assert np.linalg.norm(motion_between(truth, result.transform)[:3]) < 0.02


@pytest.mark.parametrize(
    "shape",
    [
        trimesh.creation.icosphere(subdivisions=3, radius=40.0),
        trimesh.creation.cylinder(radius=20.0, height=400.0, sections=128),
    ],
)
def test_surface_along_which_points_slide_is_rejected(shape):
    rng = np.random.default_rng(4)
    truth, points, start = touch_surface(rng, shape, 40, 0.1)
    mapped = truth.apply(points)
    points = points[np.abs(mapped[:, 2]) < 150.0]  # not on the caps of the cylinder
    with pytest.raises((FreeMotionError, NoConsensusError), match=r"slide|equally good"):
        register_surface(points, mesh_of(shape), start=start)


def test_target_error_decides_acceptance():
    rng = np.random.default_rng(5)
    _, points, start = touch_surface(rng, SHAPE, 40, 0.3)
    near = register_surface(points, MESH, start=start, targets_mm=[[0.0, 0.0, 0.0]])
    far = register_surface(points, MESH, start=start, targets_mm=[[900.0, 0.0, 0.0]])
    assert near.accepted and not far.accepted
    assert predict_tre(far, [[900.0, 0, 0]])[0] > 4.0 * predict_tre(near, [[0.0, 0, 0]])[0]
    assert near.fre_mm == far.fre_mm
    # A point pulls the fit towards itself, so its error without it is larger.
    assert (near.leave_one_out_mm > near.residuals_mm).all()
    limits = AcceptanceLimits(leave_one_out_mm=0.1)
    strict = register_surface(points, MESH, start=start, limits=limits)
    assert not strict.accepted and "leave-one-out" in strict.reason


def test_invalid_input_raises_specific_errors():
    rng = np.random.default_rng(6)
    _, points, start = touch_surface(rng, SHAPE, 40, 0.1)
    holed = np.where(np.arange(40)[:, None] == 3, np.nan, points)
    anywhere = rng.uniform(-50, 50, (16, 3))
    for error, message, given, options in (
        (TooFewError, "11 touched points", points[:11], {}),
        (NotFiniteError, "point 3 of touched_mm", holed, {}),
        (FrameError, "ct", points, {"start": start.renamed(target="mri")}),
        (ShapeError, "inlier_mm", points, {"inlier_mm": 0.0}),
        ((NoConsensusError, ConvergenceError), "", anywhere, {"inlier_mm": 0.5}),
    ):
        with pytest.raises(error, match=message):
            register_surface(given, MESH, **{"start": start, **options})
