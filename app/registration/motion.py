"""Small motions of a frame, and what they do to points: the convention of every covariance here.

A small motion is six numbers ``(omega, v)``: a rotation vector in rad, then a translation in mm,
both in the target frame and about its origin. It acts from the left::

    true target_from_source  =  Exp(omega, v)  @  estimated target_from_source
    true point               ~  point + omega x point + v

A 6x6 covariance is the covariance of these six numbers, so the covariance of a point ``p`` is
``J C J^T`` with ``J = [-[p]x, 1]``.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from app.geometry import FloatArray, Transform


def skew(vectors: FloatArray) -> FloatArray:
    """The matrices ``[v]x`` with ``[v]x w = v x w``: (..., 3) to (..., 3, 3)."""
    matrices = np.zeros((*vectors.shape, 3))
    matrices[..., 0, 1], matrices[..., 0, 2] = -vectors[..., 2], vectors[..., 1]
    matrices[..., 1, 0], matrices[..., 1, 2] = vectors[..., 2], -vectors[..., 0]
    matrices[..., 2, 0], matrices[..., 2, 1] = -vectors[..., 1], vectors[..., 0]
    return matrices


def point_jacobian(points_mm: FloatArray) -> FloatArray:
    """How points (n, 3) answer to a small motion of their frame, (n, 3, 6)."""
    identity = np.broadcast_to(np.eye(3), (len(points_mm), 3, 3))
    return np.concatenate([-skew(points_mm), identity], axis=2)


def origin_change(to_mm: FloatArray) -> FloatArray:
    """The matrix (6, 6) that takes a motion about the origin to the same motion about ``to_mm``."""
    change = np.eye(6)
    change[3:, :3] = -skew(to_mm)
    return change


def move_origin(covariance: FloatArray, to_mm: FloatArray) -> FloatArray:
    """The covariance (6, 6) of a motion about the origin, for the same motion about ``to_mm``."""
    change = origin_change(to_mm)
    return np.asarray(change @ covariance @ change.T)


def moved(estimate: Transform, motion: FloatArray, about_mm: FloatArray) -> Transform:
    """``estimate`` after a turn by ``motion[:3]`` about ``about_mm`` and a shift ``motion[3:]``."""
    turn = Rotation.from_rotvec(motion[:3]).as_matrix()
    translation = turn @ (estimate.translation_mm - about_mm) + about_mm + motion[3:]
    return Transform(estimate.target, estimate.source, turn @ estimate.rotation, translation)


def difference(truth: Transform, estimate: Transform) -> FloatArray:
    """The motion (6,) about the origin that takes ``estimate`` to ``truth``, exact in rotation.

    The translation part is the shift of the origin, as `point_jacobian` has it.
    """
    turn = truth.rotation @ estimate.rotation.T
    shift = truth.translation_mm - turn @ estimate.translation_mm
    return np.concatenate([Rotation.from_matrix(turn).as_rotvec(), shift])
