"""Small motions of a frame, the convention of all covariances in this package, and fits by them.

A small motion is six numbers ``(omega, v)``: a rotation vector in rad and a translation in mm,
both in the target frame and about its origin. It is applied from the left::

    true target_from_source  =  Exp(omega, v)  @  estimated target_from_source
    true point               ~  point + omega x point + v

A 6x6 covariance is the covariance of these six numbers, so the covariance of a point ``p`` is
``J C J^T`` with ``J = [-[p]x, 1]``.
"""

from collections.abc import Callable
from typing import TypeVar

import numpy as np
import scipy  # loads `scipy.spatial` lazily, which takes 0.2 s

from app.geometry import FloatArray, Transform
from app.registration.input_checks import ConvergenceError


def skew(vectors: FloatArray) -> FloatArray:
    """Return the matrices ``[v]x`` with ``[v]x w = v x w``: (..., 3) to (..., 3, 3)."""
    matrices = np.zeros((*vectors.shape, 3))
    matrices[..., 0, 1], matrices[..., 0, 2] = -vectors[..., 2], vectors[..., 1]
    matrices[..., 1, 0], matrices[..., 1, 2] = vectors[..., 2], -vectors[..., 0]
    matrices[..., 2, 0], matrices[..., 2, 1] = -vectors[..., 1], vectors[..., 0]
    return matrices


def point_jacobian(points_mm: FloatArray) -> FloatArray:
    """Derivative (n, 3, 6) of points (n, 3) in mm by a small motion of their frame."""
    identity = np.broadcast_to(np.eye(3), (len(points_mm), 3, 3))
    return np.concatenate([-skew(points_mm), identity], axis=2)


def origin_change(to_mm: FloatArray) -> FloatArray:
    """Matrix (6, 6) that converts a motion about the origin to one about ``to_mm`` (3,)."""
    change = np.eye(6)
    change[3:, :3] = -skew(to_mm)
    return change


def move_origin(covariance: FloatArray, to_mm: FloatArray) -> FloatArray:
    """Convert a covariance (6, 6) of motions about the origin to motions about ``to_mm`` (3,)."""
    change = origin_change(to_mm)
    return np.asarray(change @ covariance @ change.T)


def apply_motion(estimate: Transform, motion: FloatArray, about_mm: FloatArray) -> Transform:
    """Rotate ``estimate`` by ``motion[:3]`` about ``about_mm``, then shift by ``motion[3:]``."""
    rotation = scipy.spatial.transform.Rotation.from_rotvec(motion[:3]).as_matrix()
    translation = rotation @ (estimate.translation_mm - about_mm) + about_mm + motion[3:]
    return Transform(estimate.target, estimate.source, rotation @ estimate.rotation, translation)


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
) -> State:
    """Return the state near ``start`` with the smallest sum of squared residuals.

    ``linearise`` returns the whitened residuals (k,) and their negative Jacobian (k, p): after a
    small motion ``m`` (p,) of the state the residuals are about ``residuals - jacobian @ m``.
    ``retract`` applies such a motion to a state. Iterates until a step changes the residuals by
    less than `CONVERGED_SIGMAS`. Raises `ConvergenceError` with ``what`` after `MAX_STEPS` steps.
    """
    state, damping = start, 0.0
    residuals, jacobian = linearise(state)
    for _ in range(MAX_STEPS):
        normal = jacobian.T @ jacobian
        damped = normal + damping * np.diag(np.diag(normal))
        step = np.asarray(np.linalg.solve(damped, jacobian.T @ residuals), dtype=np.float64)
        candidate = retract(state, step)
        new_residuals, new_jacobian = linearise(candidate)
        change = jacobian @ step
        predicted = 2.0 * float(residuals @ change) - float(change @ change)
        gain = float(residuals @ residuals) - float(new_residuals @ new_residuals)
        change_norm = float(np.linalg.norm(change))
        converged = change_norm < CONVERGED_SIGMAS or (change_norm < ROUNDING_SIGMAS and gain < 0.0)
        if gain >= 0.0:
            state, residuals, jacobian = candidate, new_residuals, new_jacobian
        # A step that gains much less than predicted was too long.
        if gain < 0.25 * predicted:
            damping = max(10.0 * damping, 1e-6)
        elif gain > 0.75 * predicted:
            damping /= 10.0
        if converged:
            return state
    raise ConvergenceError(f"{what} did not converge in {MAX_STEPS} steps")
