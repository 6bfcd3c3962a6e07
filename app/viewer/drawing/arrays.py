"""Arrays as the components of trame-vtk take them in the page's state."""

import base64
from typing import Any

import numpy as np
from numpy.typing import NDArray

Values = dict[str, Any]


def encoded(values: NDArray[np.generic]) -> Values:
    """The values of an array of float32, uint32 or uint8, in their order."""
    text = base64.b64encode(np.ascontiguousarray(values).tobytes()).decode("ascii")
    return {"bvals": text, "dtype": str(values.dtype), "shape": [int(values.size)]}
