"""Linear transforms as ITK stores them, in text (``.tfm``) and in HDF5 (``.h5``).

The file does not hold the matrix that Slicer displays. ITK uses LPS axes where Slicer uses RAS (x
and y negated), and stores the transform from the parent, which resamples an image. With
``F = diag(-1, -1, 1, 1)`` the file's matrix is ``F inverse(M) F`` for the ``M`` (to parent, RAS) of
Slicer's transforms module. The file rotates about a centre ``c``: ``y = A (x - c) + c + t`` (ITK,
`MatrixOffsetTransformBase`). Slicer writes a centre; here it is 0.
"""

from collections.abc import Sequence

import numpy as np

from app.geometry import FloatArray, InputError, Transform

RAS_LPS = np.diag([-1.0, -1.0, 1.0, 1.0])
"""RAS coordinates to LPS, and LPS to RAS."""

ITK_LINEAR = ("AffineTransform_double_3_3", "MatrixOffsetTransformBase_double_3_3")
"""Types of transforms with the 12 parameters of a matrix; the first is the one written."""

_MAX_CENTRE_MM = 1e6
"""Largest coordinate of a centre of rotation; a larger one cancels digits of the translation."""


def matrix_from_parameters(
    parameters: Sequence[float], centre_mm: Sequence[float], place: str
) -> FloatArray:
    """The matrix (4, 4), to parent and in RAS, of a linear transform of ITK.

    ``parameters`` are 12 numbers, ``centre_mm`` 3, the fixed parameters. Raises `InputError`, with
    ``place``, for a centre that is too far away, and a `MarginGuardError` for a matrix that is not
    rigid.
    """
    values, centre = np.array(parameters), np.array(centre_mm)
    if not np.abs(centre).max() <= _MAX_CENTRE_MM:
        raise InputError(
            f"{place}: the centre, FixedParameters, is {centre.tolist()}; expected coordinates "
            f"of at most {_MAX_CENTRE_MM:g} mm"
        )
    stored = Transform("lps", "lps", values[:9].reshape(3, 3), values[9:])
    turned = stored.rotation @ centre
    about_origin = Transform("lps", "lps", stored.rotation, values[9:] + centre - turned)
    return np.asarray(RAS_LPS @ about_origin.inverse().matrix @ RAS_LPS)
