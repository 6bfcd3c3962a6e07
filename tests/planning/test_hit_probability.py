"""Probabilities against plain Monte Carlo: with coal on rough shapes, by formula on a ball."""

import math

import numpy as np
import pytest
import trimesh

from app.geometry import InputError, SurfaceMesh
from app.planning import covariance_of, hit_probability
from app.planning.corridor_distance import closed_surface
from tests.oracles.needle_oracle import NeedleOracle
from tests.planning.needle_scenes import FRAME, blob

pytestmark = pytest.mark.slow

SAMPLES, BY_COAL = 30_000, 5000
BALL = trimesh.creation.icosphere(4, 10.0)
RADIUS = 0.5 * (10.0 + math.sqrt((BALL.triangles.mean(axis=1) ** 2).sum(axis=1).min()))
"""Radius of a ball between the corners and the faces of the mesh, which are 0.02 mm apart."""


def random_covariance(rng):
    root = rng.normal(size=(3, 3)) * rng.choice([0.0, 0.03, 1.0, 1.0], 3)
    return root @ root.T * rng.choice([0.1, 1.0, 4.0])


@pytest.mark.parametrize("seed", [1])
def test_probability_of_a_rough_structure_is_that_of_monte_carlo_with_coal(seed):
    rng = np.random.default_rng(seed)
    mesh = blob(rng, np.zeros(3), 8.0, level=1)
    covariance, radius = random_covariance(rng), rng.uniform(0.3, 1.0)
    # A needle that grazes the structure, whose tip may be beside it or inside.
    start = np.array([*rng.uniform(-9.0, 9.0, 2), 40.0])
    end = np.array([*rng.uniform(-9.0, 9.0, 2), rng.uniform(-30.0, 5.0)])
    oracle = NeedleOracle(mesh)
    axis = (end - start) / np.linalg.norm(end - start)
    errors = rng.multivariate_normal(np.zeros(3), covariance, BY_COAL)
    lateral = errors - np.outer(errors @ axis, axis)
    hits = sum(
        oracle.clearance(start + each, end + each, radius) <= 0.0 or oracle.contains(end + each)
        for each in lateral
    )
    found = hit_probability(
        closed_surface(mesh, "structure"),
        start,
        end,
        radius_mm=radius,
        covariance_mm2=covariance,
        sigma_mm=0.0,
    )
    assert found == pytest.approx(hits / BY_COAL, abs=0.01)


def of_ball(offset, covariance, sigma):
    """The probability that a needle at ``offset`` (3,) from the centre hits the ball."""
    return hit_probability(
        closed_surface(SurfaceMesh(FRAME, BALL.vertices, BALL.faces), "ball"),
        offset + np.array([0.0, 0.0, 50.0]),
        offset - np.array([0.0, 0.0, 30.0]),
        radius_mm=0.6,
        covariance_mm2=covariance,
        sigma_mm=sigma,
    )


@pytest.mark.parametrize("seed", range(20))
def test_probability_of_a_ball_is_that_of_monte_carlo(seed):
    rng = np.random.default_rng(seed)
    covariance, sigma = random_covariance(rng), rng.choice([0.0, 0.3, 1.0, 2.0])
    offset = np.array([rng.uniform(0.0, 14.0), rng.uniform(-3.0, 3.0), 0.0])
    errors = rng.multivariate_normal(np.zeros(3), covariance, SAMPLES)[:, :2]
    distance = np.linalg.norm(offset[:2] + errors, axis=1) - RADIUS - 0.6
    expected = (distance + sigma * rng.normal(size=SAMPLES) <= 0.0).mean()
    assert of_ball(offset, covariance, sigma) == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize(("offset", "expected"), [(10.5, 1.0), (10.7, 0.0)])
def test_without_any_error_the_needle_hits_or_it_does_not(offset, expected):
    found = of_ball(np.array([offset, 0.0, 0.0]), np.zeros((3, 3)), 0.0)
    assert found == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    "error",
    [
        -1.0,
        math.nan,
        1e300,
        np.eye(3) * 1e300,
        [1.0, 2.0, 3.0],
        np.diag([1.0, 1.0, -1.0]),
        np.triu(np.ones((3, 3))),
    ],
)
def test_error_that_is_no_covariance_is_refused(error):
    with pytest.raises(InputError, match=r"error of the needle: is .*; expected a standard dev"):
        covariance_of(error)
