"""Where on the tumour and on the tool a breach is: the one rule for page, report and analysis."""

import numpy as np
from numpy.typing import ArrayLike

from app.geometry import FloatArray, InputError, anatomical_direction, closest_rotation

TIP_MM = 2.0
"""A point of the tool this near to its tip is part of the tip."""


def place_letters(outward_mm: FloatArray, ras_from_tumor: FloatArray | None = None) -> str:
    """Letters of the direction ``outward_mm`` (3,), from the tumour's centre to a place on it.

    The letters are those of `anatomical_direction`; empty for length 0 and for unknown numbers.
    ``outward_mm`` is in the tumour's frame, whose axes are taken as right, anterior and superior
    (`docs/case_format.md`, axes) unless ``ras_from_tumor`` (3, 3) turns them.
    """
    if not np.isfinite(outward_mm).all():
        return ""
    turned = outward_mm if ras_from_tumor is None else ras_from_tumor @ outward_mm
    return anatomical_direction(turned)


def is_tip(from_tip_mm: float) -> bool:
    """Whether a point of the tool at this distance from its tip is part of the tip."""
    return from_tip_mm <= TIP_MM


def checked_axes(ras_from_tumor: ArrayLike | None) -> FloatArray | None:
    """The rotation (3, 3); raises `InputError` for a matrix that is no rotation."""
    if ras_from_tumor is None:
        return None
    matrix = np.asarray(ras_from_tumor, dtype=np.float64)
    if matrix.shape != (3, 3) or not np.isfinite(matrix).all():
        raise InputError(f"ras_from_tumor has shape {matrix.shape}; expected a rotation (3, 3)")
    if np.abs(matrix.T @ matrix - np.eye(3)).max() > 1e-3 or np.linalg.det(matrix) < 0.0:
        raise InputError("ras_from_tumor is no rotation; expected orthonormal rows, no reflection")
    return closest_rotation(matrix)
