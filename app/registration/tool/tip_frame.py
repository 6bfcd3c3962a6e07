"""The frame of a tool's tip from the position of the tip and the direction of the shaft."""

import numpy as np
from numpy.typing import ArrayLike

from app.geometry import Transform
from app.registration.errors import ShapeError
from app.registration.inputs import as_point


def tip_transform(
    tip_mm: ArrayLike, shaft: ArrayLike, *, tool_frame: str, tip_frame: str
) -> Transform:
    """Return ``tool_from_tip``: origin at ``tip_mm`` (3,), +z along ``shaft`` (3,), tool frame.

    The shaft points from the sensor to the tip. Pivot and spin do not determine the rotation about
    the shaft: +x is the tool's x-axis projected perpendicular to the shaft, or its y-axis if x is
    within 26 degrees of the shaft. Raises `ShapeError` for a shaft of length 0.
    """
    tip = as_point(tip_mm, "tip_mm")
    axis = as_point(shaft, "shaft")
    length = float(np.linalg.norm(axis))
    if length < 1e-9:
        raise ShapeError(f"shaft is {axis.tolist()}; expected a vector that is not 0")
    z = axis / length
    axis_hint = np.eye(3)[0] if abs(z[0]) < 0.9 else np.eye(3)[1]
    x = axis_hint - (axis_hint @ z) * z
    x /= np.linalg.norm(x)
    return Transform(tool_frame, tip_frame, np.column_stack([x, np.cross(z, x), z]), tip)
