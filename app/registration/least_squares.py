"""Levenberg-Marquardt on a manifold: the state is stepped by a small motion, never by numbers."""

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from app.geometry import FloatArray
from app.registration.errors import ConvergenceError

State = TypeVar("State")

MAX_STEPS = 200

SETTLED_SIGMAS = 1e-9
"""A step that moves the residuals by less than this, in standard deviations, is the last one."""

ROUNDING_SIGMAS = 1e-5
"""So is one below this that makes nothing better: what is left is rounding."""


def least_squares(
    start: State,
    linearise: Callable[[State], tuple[FloatArray, FloatArray]],
    retract: Callable[[State, FloatArray], State],
    what: str,
) -> State:
    """The state with the least sum of squared residuals near ``start``.

    ``linearise`` gives the whitened residuals (k,) and how they *fall* with a small motion of the
    state, (k, p): a motion ``m`` leaves about ``residuals - jacobian @ m``. ``retract`` applies
    such a motion. Raises `ConvergenceError` that names ``what`` when it does not settle.
    """
    state, damping = start, 0.0
    residuals, jacobian = linearise(state)
    for _ in range(MAX_STEPS):
        normal = jacobian.T @ jacobian
        damped = normal + damping * np.diag(np.diag(normal))
        step = np.asarray(np.linalg.solve(damped, jacobian.T @ residuals), dtype=np.float64)
        candidate = retract(state, step)
        new_residuals, new_jacobian = linearise(candidate)
        better = float(new_residuals @ new_residuals) <= float(residuals @ residuals)
        moved = float(np.linalg.norm(jacobian @ step))
        settled = moved < SETTLED_SIGMAS or (moved < ROUNDING_SIGMAS and not better)
        if better:
            state, residuals, jacobian = candidate, new_residuals, new_jacobian
            damping /= 10.0
        else:
            damping = max(10.0 * damping, 1e-6)
        if settled:
            return state
    raise ConvergenceError(f"{what} did not settle in {MAX_STEPS} steps")
