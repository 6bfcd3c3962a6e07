import dataclasses

import numpy as np
import pytest

from app.geometry import Transform
from app.registration import (
    AcceptanceLimits,
    CovarianceError,
    RegistrationResult,
    ShapeError,
    given_registration,
    judge,
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


def test_arrays_are_copies_that_cannot_be_written() -> None:
    residuals = np.zeros(4)
    result = build(residuals_mm=residuals)
    residuals[0] = 9.0
    assert result.residuals_mm[0] == 0.0
    for array in (result.residuals_mm, result.leave_one_out_mm, result.covariance):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        result.accepted = False  # type: ignore[misc]


def test_used_leaves_out_the_outliers() -> None:
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
def test_inconsistent_results_are_refused(
    change: dict[str, object], error: type[Exception]
) -> None:
    with pytest.raises(error):
        build(**change)


@pytest.mark.parametrize("bad", [0.0, -1.0, float("nan"), float("inf")])
def test_limits_are_checked(bad: float) -> None:
    with pytest.raises(ShapeError, match="tre_mm"):
        AcceptanceLimits(tre_mm=bad)
    with pytest.raises(ShapeError, match="leave_one_out_mm"):
        AcceptanceLimits(leave_one_out_mm=bad)


def test_correlations_that_contradict_each_other_are_no_covariance() -> None:
    """Rad and mm of very different sizes: the first two agree, and the third goes with one only."""
    sigmas = np.array([1e-3, 1e-3, 1e-3, 1.0, 1.0, 1.0])
    correlations = np.eye(6)
    correlations[:3, :3] = [[1.0, 0.9, -0.9], [0.9, 1.0, 0.9], [-0.9, 0.9, 1.0]]
    with pytest.raises(CovarianceError, match="negative variance along some motion"):
        build(covariance=correlations * np.outer(sigmas, sigmas))
    correlations[0, 2] = correlations[2, 0] = 0.7
    assert build(covariance=correlations * np.outer(sigmas, sigmas)).covariance is not None
    assert build(covariance=np.diag([0.0, 0.0, 0.0, 1.0, 1.0, 1.0])).covariance is not None
    assert build(covariance=np.zeros((6, 6))).covariance is not None


def test_the_worst_target_decides() -> None:
    """A turn of 0.1 rad about z: nothing on the axis, 10 mm a decimetre from it."""
    turning = build(covariance=np.diag([0.0, 0.0, 0.01, 0.0, 0.0, 0.0]))
    limits = AcceptanceLimits(tre_mm=5.0)
    assert judge(turning, [[0.0, 0.0, 50.0]], limits).accepted
    verdict = judge(turning, [[0.0, 0.0, 50.0], [0.0, 100.0, 0.0]], limits)
    assert not verdict.accepted
    assert verdict.reason == (
        "predicted TRE may be 10 mm RMS (95 %) at target 1 (0.0, 100.0, 0.0), 5 mm allowed"
    )


def test_an_error_that_overflows_is_not_accepted() -> None:
    """Infinite less infinite is no number, and no number is above no limit."""
    covariance = 100.0 * np.eye(6)
    covariance[1, 5] = covariance[5, 1] = 50.0
    covariance[2, 4] = covariance[4, 2] = -50.0
    with np.errstate(over="ignore", invalid="ignore"):
        verdict = judge(build(covariance=covariance), [[1.7e308, 0.0, 0.0]], AcceptanceLimits())
    assert not verdict.accepted


def test_a_given_registration_cannot_be_judged() -> None:
    given = given_registration(Transform.identity("fixed", "moving"))
    with pytest.raises(CovarianceError):
        judge(given, [[0.0, 0.0, 0.0]], AcceptanceLimits())
