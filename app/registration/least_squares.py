"""Levenberg-Marquardt on a manifold: the state is stepped by a small motion, never by numbers."""

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from app.geometry import FloatArray
from app.registration.errors import ConvergenceError

State = TypeVar("State")

MAX_STEPS = 200

SETTLED_SIGMAS = 1e-9
"""Norm of the change of the whitened residuals, in standard deviations, of a last step."""

ROUNDING_SIGMAS = 1e-5
"""A step below this that makes nothing better is the last one too: what is left is rounding."""


def least_squares(
    start: State,
    linearise: Callable[[State], tuple[FloatArray, FloatArray]],
    retract: Callable[[State, FloatArray], State],
    what: str,
    *,
    settled_at: float = SETTLED_SIGMAS,
    max_steps: int = MAX_STEPS,
) -> State:
    """The state with the least sum of squared residuals near ``start``.

    ``linearise`` gives the whitened residuals (k,) and how they *fall* with a small motion of the
    state, (k, p): a motion ``m`` leaves about ``residuals - jacobian @ m``. ``retract`` applies
    such a motion. A step that moves the residuals by less than ``settled_at`` is the last. Raises
    `ConvergenceError` that names ``what`` when there is none.
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
        moved = float(np.linalg.norm(change))
        settled = moved < settled_at or (moved < ROUNDING_SIGMAS and gain < 0.0)
        if gain >= 0.0:
            state, residuals, jacobian = candidate, new_residuals, new_jacobian
        # Steps that gain far less than they promise stand at a kink: shorter ones end there.
        if gain < 0.25 * predicted:
            damping = max(10.0 * damping, 1e-6)
        elif gain > 0.75 * predicted:
            damping /= 10.0
        if settled:
            return state
    raise ConvergenceError(f"{what} did not settle in {max_steps} steps")
