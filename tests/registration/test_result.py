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


def test_a_given_registration_cannot_be_judged() -> None:
    given = given_registration(Transform.identity("fixed", "moving"))
    with pytest.raises(CovarianceError):
        judge(given, [[0.0, 0.0, 0.0]], AcceptanceLimits())
