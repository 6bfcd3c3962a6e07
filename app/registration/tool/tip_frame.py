"""The frame of a tool's tip from where the tip is and where the shaft points."""

import numpy as np
from numpy.typing import ArrayLike

from app.geometry import Transform
from app.registration.errors import ShapeError
from app.registration.inputs import as_point


def tip_transform(
    tip_mm: ArrayLike, shaft: ArrayLike, *, tool_frame: str, tip_frame: str
) -> Transform:
    """``tool_from_tip``: origin at ``tip_mm`` (3,), +z along ``shaft`` (3,), in the tool frame.

    The shaft points from the sensor to the tip. A pivot and a spin leave the turn about the shaft
    open: +x is the tool's own x-axis laid across the shaft, its y-axis where x runs along it.
    """
    tip = as_point(tip_mm, "tip_mm")
    axis = as_point(shaft, "shaft")
    length = float(np.linalg.norm(axis))
    if length < 1e-9:
        raise ShapeError(f"shaft is {axis.tolist()}: a direction wanted")
    z = axis / length
    across = np.eye(3)[0] if abs(z[0]) < 0.9 else np.eye(3)[1]
    x = across - (across @ z) * z
    x /= np.linalg.norm(x)
    return Transform(tool_frame, tip_frame, np.column_stack([x, np.cross(z, x), z]), tip)
