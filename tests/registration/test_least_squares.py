"""Levenberg-Marquardt on known problems."""

import numpy as np
import pytest

from app.geometry import FloatArray
from app.registration import ConvergenceError
from app.registration.least_squares import least_squares


def add(state: FloatArray, step: FloatArray) -> FloatArray:
    return state + step


def test_rosenbrock_converges() -> None:
    """Full Gauss-Newton steps overshoot on this function."""

    def linearise(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        residuals = np.array([10.0 * (x[1] - x[0] ** 2), 1.0 - x[0]])
        return residuals, -np.array([[-20.0 * x[0], 10.0], [-1.0, 0.0]])

    np.testing.assert_allclose(
        least_squares(np.array([-1.2, 1.0]), linearise, add, "it"), [1.0, 1.0], atol=1e-9
    )


def test_linear_problem_agrees_with_lstsq() -> None:
    rng = np.random.default_rng(1)
    matrix, right = rng.normal(size=(9, 4)), rng.normal(size=9)
    answer = least_squares(np.zeros(4), lambda x: (right - matrix @ x, matrix), add, "it")
    np.testing.assert_allclose(answer, np.linalg.lstsq(matrix, right, rcond=None)[0], atol=1e-10)


def test_converges_at_a_kink() -> None:
    """|x - 3| + 1, whose slope jumps at its minimum."""

    def linearise(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        return np.abs(x - 3.0) + 1.0, -np.diag(np.sign(x - 3.0))

    answer = least_squares(np.array([10.0]), linearise, add, "it", tolerance=1e-6)
    np.testing.assert_allclose(answer, [3.0], atol=1e-4)


def test_missing_convergence_is_an_error() -> None:
    def linearise(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        return np.exp(-x), np.exp(-x)[:, None]  # decreases without a minimum

    with pytest.raises(ConvergenceError, match="the slide did not converge in 5 steps"):
        least_squares(np.array([0.0]), linearise, add, "the slide", max_steps=5)
