"""Levenberg-Marquardt on a manifold."""

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from app.geometry import FloatArray
from app.registration.errors import ConvergenceError

State = TypeVar("State")

MAX_STEPS = 200

CONVERGED_SIGMAS = 1e-9
"""Converged if a step changes the norm of the whitened residuals by less (in sigmas)."""

ROUNDING_SIGMAS = 1e-5
"""Also converged if a step below this does not reduce the residuals: only rounding is left."""


def least_squares(
    start: State,
    linearise: Callable[[State], tuple[FloatArray, FloatArray]],
    retract: Callable[[State, FloatArray], State],
    what: str,
    *,
    tolerance: float = CONVERGED_SIGMAS,
    max_steps: int = MAX_STEPS,
) -> State:
    """Return the state near ``start`` with the smallest sum of squared residuals.

    ``linearise`` returns the whitened residuals (k,) and their negative Jacobian (k, p): after a
    small motion ``m`` (p,) of the state the residuals are about ``residuals - jacobian @ m``.
    ``retract`` applies such a motion to a state. Iterates until a step changes the residuals by
    less than ``tolerance``. Raises `ConvergenceError` with ``what`` after ``max_steps`` steps.
    """
    state, damping = start, 0.0
    residuals, jacobian = linearise(state)
    for _ in range(max_steps):
        normal = jacobian.T @ jacobian
        damped = normal + damping * np.diag(np.diag(normal))
        step = np.asarray(np.linalg.solve(damped, jacobian.T @ residuals), dtype=np.float64)
        candidate = retract(state, step)
        new_residuals, new_jacobian = linearise(candidate)
        change = jacobian @ step
        predicted = 2.0 * float(residuals @ change) - float(change @ change)
        gain = float(residuals @ residuals) - float(new_residuals @ new_residuals)
        change_norm = float(np.linalg.norm(change))
        converged = change_norm < tolerance or (change_norm < ROUNDING_SIGMAS and gain < 0.0)
        if gain >= 0.0:
            state, residuals, jacobian = candidate, new_residuals, new_jacobian
        # A step that gains much less than predicted crosses a kink; shorter steps converge to it.
        if gain < 0.25 * predicted:
            damping = max(10.0 * damping, 1e-6)
        elif gain > 0.75 * predicted:
            damping /= 10.0
        if converged:
            return state
    raise ConvergenceError(f"{what} did not converge in {max_steps} steps")
