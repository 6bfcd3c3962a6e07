"""Where on the tumour and on the tool: directions and parts as words.

Anatomical directions need the patient's axes. Where they are given (``ras_from_tumor``) a direction
is named by right or left, anterior or posterior, superior or inferior. Otherwise the axes of the
tumour's frame name it: ``+x``. A component counts if it is at least half of the largest.
"""

import numpy as np
from numpy.typing import ArrayLike

from app.geometry import FloatArray, InputError, closest_rotation

_RAS = (("left", "right"), ("posterior", "anterior"), ("inferior", "superior"))
_AXES = (("-x", "+x"), ("-y", "+y"), ("-z", "+z"))
_COUNTS = 0.5
TIP_MM = 3.0
"""Points of the tool within this distance of its tip are part of the tip."""


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


def direction_name(direction: FloatArray, ras_from_tumor: FloatArray | None) -> str:
    """The name of ``direction`` (3,), in the tumour's frame: ``anterior-left`` or ``+x+z``.

    Empty for a direction of length 0.
    """
    names = _AXES if ras_from_tumor is None else _RAS
    turned = direction if ras_from_tumor is None else ras_from_tumor @ direction
    size = np.abs(turned)
    if not np.isfinite(size).all() or size.max() <= 0.0:
        return ""
    order = np.argsort(-size, kind="stable").tolist()
    parts = [names[k][int(turned[k] > 0.0)] for k in order if size[k] >= _COUNTS * size.max()]
    return ("" if ras_from_tumor is None else "-").join(parts)


def principal_direction(direction: FloatArray, ras_from_tumor: FloatArray | None) -> str:
    """The one of the six names that is nearest to ``direction``; empty for length 0."""
    names = _AXES if ras_from_tumor is None else _RAS
    turned = direction if ras_from_tumor is None else ras_from_tumor @ direction
    size = np.abs(turned)
    if not np.isfinite(size).all() or size.max() <= 0.0:
        return ""
    largest = int(np.argmax(size))
    return names[largest][int(turned[largest] > 0.0)]


def tool_part(on_tool_mm: FloatArray) -> str:
    """``tip`` or ``shaft`` for a point (3,) in the tip's frame; empty if it is not known."""
    if not np.isfinite(on_tool_mm).all():
        return ""
    return "tip" if float(np.linalg.norm(on_tool_mm)) <= TIP_MM else "shaft"
