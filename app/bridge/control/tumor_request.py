"""A request for ``~/set_tumor`` as arrays, without a Python object for each triangle.

rclpy converts a message element by element while it holds the GIL: 1 s for 300 000 triangles,
during which no constraint is sent. `ArrayRequest` replaces that conversion by copies of the two
arrays. The layout of the C structures is the one that rosidl_generator_c defines.
"""

import ctypes
from dataclasses import dataclass
from typing import Any

import numpy as np
from marginguard_msgs.srv import SetTumor
from numpy.typing import NDArray

from app.geometry import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class TumorRequest:
    """The content of a `SetTumor.Request`, in its units.

    ``position_m`` (3,) and ``quaternion`` (4,), xyzw, are its pose in ``frame_id``. ``triangles``
    (m, 3) are vertex indices, ``vertices_m`` (n, 3) positions.
    """

    frame_id: str
    position_m: FloatArray
    quaternion: FloatArray
    triangles: NDArray[np.uint32]
    vertices_m: FloatArray


class _Array(ctypes.Structure):  # a string or a sequence
    _fields_ = [("data", ctypes.c_void_p), ("size", ctypes.c_size_t), ("room", ctypes.c_size_t)]


class _Request(ctypes.Structure):
    _fields_ = [
        ("sec", ctypes.c_int32),
        ("nanosec", ctypes.c_uint32),
        ("frame_id", _Array),
        ("pose", ctypes.c_double * 7),
        ("triangles", _Array),  # of uint32[3]
        ("vertices", _Array),  # of double[3]
    ]


def _convert(address: int) -> TumorRequest:
    request = _Request.from_address(address)
    frame_id = ctypes.string_at(request.frame_id.data, request.frame_id.size)
    pose = np.array(request.pose)
    return TumorRequest(
        frame_id.decode("utf-8", "replace"),
        pose[:3],
        pose[3:],
        _rows(request.triangles, np.uint32),
        _rows(request.vertices, np.float64),
    )


def _rows(sequence: _Array, dtype: Any) -> NDArray[Any]:
    rows = np.empty((sequence.size, 3), dtype=dtype)
    ctypes.memmove(rows.ctypes.data, sequence.data, rows.nbytes)  # releases the GIL
    return rows


_converter = ctypes.PYFUNCTYPE(ctypes.py_object, ctypes.c_void_p)(_convert)
SetTumor.Request.__class__.__import_type_support__()

_new_capsule = ctypes.pythonapi.PyCapsule_New
_new_capsule.restype = ctypes.py_object
_new_capsule.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p]


class _ArrayMetaclass(type(SetTumor.Request)):  # type: ignore[misc]  # built by rosidl
    """The type support of the request, with another conversion to Python."""

    _CONVERT_TO_PY = _new_capsule(ctypes.cast(_converter, ctypes.c_void_p), None, None)


class ArrayRequest(SetTumor.Request, metaclass=_ArrayMetaclass):  # type: ignore[misc]
    """A `SetTumor.Request` that rclpy receives as a `TumorRequest`."""
