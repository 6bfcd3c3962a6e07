"""Registration results and the evaluation of their acceptance."""

import dataclasses

import numpy as np
import pytest

from app.geometry import Transform
from app.registration import (
    AcceptanceLimits,
    CovarianceError,
    RegistrationResult,
    ShapeError,
    evaluate_acceptance,
    given_registration,
)


def build(**changes: object) -> RegistrationResult:
    values: dict[str, object] = {
        "transform": Transform.identity("fixed", "moving"),
        "residuals_mm": np.zeros(4),
        "fre_mm": 0.0,
        "fle_mm": 0.0,
        "leave_one_out_mm": np.zeros(4),
        "covariance": np.eye(6),
        "condition": 1.0,
        "accepted": True,
        "reason": "because",
        "method": "test",
        "outliers": (2,),
    }
    return RegistrationResult(**{**values, **changes})  # type: ignore[arg-type]


def test_arrays_are_read_only_copies():
    residuals = np.zeros(4)
    result = build(residuals_mm=residuals)
    residuals[0] = 9.0
    assert result.residuals_mm[0] == 0.0
    for array in (result.residuals_mm, result.leave_one_out_mm, result.covariance):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        result.accepted = False  # type: ignore[misc]


def test_used_excludes_outliers():
    assert build().used == (0, 1, 3)


@pytest.mark.parametrize(
    ("change", "error"),
    [
        ({"covariance": np.eye(5)}, CovarianceError),
        ({"covariance": np.full((6, 6), np.nan)}, CovarianceError),
        ({"covariance": -np.eye(6)}, CovarianceError),
        ({"covariance": np.eye(6) + np.eye(6, k=1)}, CovarianceError),
        ({"residuals_mm": np.zeros(3)}, ShapeError),
        ({"reason": ""}, ShapeError),
    ],
)
def test_inconsistent_results_are_rejected(change, error):
    with pytest.raises(error):
        build(**change)


@pytest.mark.parametrize("bad", [0.0, -1.0, float("nan"), float("inf")])
def test_limits_are_validated(bad):
    with pytest.raises(ShapeError, match="tre_mm"):
        AcceptanceLimits(tre_mm=bad)
    with pytest.raises(ShapeError, match="leave_one_out_mm"):
        AcceptanceLimits(leave_one_out_mm=bad)


def test_inconsistent_correlations_are_rejected():
    """The scales of rad and mm differ; the third correlation contradicts the first two."""
    sigmas = np.array([1e-3, 1e-3, 1e-3, 1.0, 1.0, 1.0])
    correlations = np.eye(6)
    correlations[:3, :3] = [[1.0, 0.9, -0.9], [0.9, 1.0, 0.9], [-0.9, 0.9, 1.0]]
    with pytest.raises(CovarianceError, match="negative variance along some motion"):
        build(covariance=correlations * np.outer(sigmas, sigmas))
    correlations[0, 2] = correlations[2, 0] = 0.7
    assert build(covariance=correlations * np.outer(sigmas, sigmas)).covariance is not None
    assert build(covariance=np.diag([0.0, 0.0, 0.0, 1.0, 1.0, 1.0])).covariance is not None
    assert build(covariance=np.zeros((6, 6))).covariance is not None


def test_worst_target_decides_acceptance():
    """A rotation of 0.1 rad about z: no error on the axis, 10 mm at a distance of 100 mm."""
    turning = build(covariance=np.diag([0.0, 0.0, 0.01, 0.0, 0.0, 0.0]))
    limits = AcceptanceLimits(tre_mm=5.0)
    assert evaluate_acceptance(turning, [[0.0, 0.0, 50.0]], limits).accepted
    evaluated = evaluate_acceptance(turning, [[0.0, 0.0, 50.0], [0.0, 100.0, 0.0]], limits)
    assert not evaluated.accepted
    assert evaluated.reason == (
        "predicted TRE may be 10 mm RMS (95 %) at target 1 (0.0, 100.0, 0.0); expected at most 5 mm"
    )


def test_overflowing_error_is_not_accepted():
    """The difference of two infinities is NaN, which is not above any limit."""
    covariance = 100.0 * np.eye(6)
    covariance[1, 5] = covariance[5, 1] = 50.0
    covariance[2, 4] = covariance[4, 2] = -50.0
    with np.errstate(over="ignore", invalid="ignore"):
        evaluated = evaluate_acceptance(
            build(covariance=covariance), [[1.7e308, 0.0, 0.0]], AcceptanceLimits()
        )
    assert not evaluated.accepted


def test_given_registration_cannot_be_evaluated():
    given = given_registration(Transform.identity("fixed", "moving"))
    with pytest.raises(CovarianceError):
        evaluate_acceptance(given, [[0.0, 0.0, 0.0]], AcceptanceLimits())


def test_given_registration_has_the_given_covariance_or_none():
    transform = Transform.identity("fixed", "moving")
    assert given_registration(transform).covariance is None
    known = given_registration(transform, np.diag([1e-6] * 3 + [0.1] * 3), 12)
    assert np.array_equal(known.covariance, np.diag([1e-6] * 3 + [0.1] * 3))
    assert (known.accepted, known.degrees_of_freedom) == (True, 12)
    with pytest.raises(CovarianceError, match="expected a symmetric matrix"):
        given_registration(transform, np.eye(6) + np.eye(6, k=1))
