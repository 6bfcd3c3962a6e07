"""Small motions of a frame: the convention of all covariances in this package.

A small motion is six numbers ``(omega, v)``: a rotation vector in rad and a translation in mm,
both in the target frame and about its origin. It is applied from the left::

    true target_from_source  =  Exp(omega, v)  @  estimated target_from_source
    true point               ~  point + omega x point + v

A 6x6 covariance is the covariance of these six numbers, so the covariance of a point ``p`` is
``J C J^T`` with ``J = [-[p]x, 1]``.
"""

import numpy as np
import scipy  # loads `scipy.spatial` lazily, which takes 0.2 s

from app.geometry import FloatArray, Transform


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


def motion_between(truth: Transform, estimate: Transform) -> FloatArray:
    """Return the motion (6,) about the origin that maps ``estimate`` to ``truth``.

    The rotation vector is exact for large rotations. The translation is that of the origin, as in
    `point_jacobian`.
    """
    rotation = truth.rotation @ estimate.rotation.T
    shift = truth.translation_mm - rotation @ estimate.translation_mm
    turn = scipy.spatial.transform.Rotation.from_matrix(rotation).as_rotvec()
    return np.concatenate([turn, shift])
