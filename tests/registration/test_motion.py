"""Small motions and their Jacobian and covariance."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from app.registration.motion import apply_motion, motion_between, move_origin, point_jacobian, skew
from tests.registration.helpers import random_transform

SEEDS = st.integers(0, 2**32 - 1)


@given(seed=SEEDS)
def test_skew_is_the_cross_product(seed: int) -> None:
    one, other = np.random.default_rng(seed).normal(size=(2, 5, 3))
    np.testing.assert_allclose(
        np.einsum("nij,nj->ni", skew(one), other), np.cross(one, other), atol=1e-12
    )


@given(seed=SEEDS)
def test_motion_between_recovers_an_applied_motion(seed: int) -> None:
    rng = np.random.default_rng(seed)
    estimate = random_transform(rng)
    motion = np.concatenate([rng.normal(scale=0.3, size=3), rng.normal(scale=20.0, size=3)])
    truth = apply_motion(estimate, motion, np.zeros(3))
    np.testing.assert_allclose(motion_between(truth, estimate), motion, atol=1e-9)


@given(seed=SEEDS)
def test_point_jacobian_is_the_derivative_of_apply_motion(seed: int) -> None:
    rng = np.random.default_rng(seed)
    estimate, points = random_transform(rng), rng.uniform(-100, 100, (4, 3))
    motion = 1e-6 * rng.normal(size=6)
    before, after = (
        t.apply(points) for t in (estimate, apply_motion(estimate, motion, np.zeros(3)))
    )
    np.testing.assert_allclose(after - before, point_jacobian(before) @ motion, atol=1e-8)


@given(seed=SEEDS)
def test_moved_covariance_gives_the_same_point_covariance(seed: int) -> None:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(6, 6)) * np.repeat([0.01, 1.0], 3)[:, None]
    covariance, centre = root @ root.T, rng.uniform(-200, 200, 3)
    point = rng.uniform(-200, 200, (1, 3))
    about_origin = point_jacobian(point)[0]
    about_centre = point_jacobian(point - centre)[0]
    np.testing.assert_allclose(
        about_centre @ move_origin(covariance, centre) @ about_centre.T,
        about_origin @ covariance @ about_origin.T,
        rtol=1e-6,
        atol=1e-9,
    )
