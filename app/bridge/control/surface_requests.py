"""Requests with a surface, received as arrays, and their conversion to millimetres."""

import ctypes
from dataclasses import dataclass
from typing import Any

import numpy as np
from marginguard_msgs.srv import SetStructure, SetTumor
from numpy.typing import NDArray

from app.bridge import messages
from app.bridge.ros_errors import BridgeError
from app.geometry import FloatArray, SurfaceMesh, Transform
from app.runtime import StructureContent
from app.runtime.replacements import MAX_LIVE_TRIANGLES
from app.session.structure import role_of


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceRequest:
    """The content of a `SetTumor.Request`, in its units.

    ``position_m`` (3,) and ``quaternion`` (4,), xyzw, are its pose in ``frame_id``. ``triangles``
    (m, 3) are vertex indices, ``vertices_m`` (n, 3) positions.
    """

    frame_id: str
    position_m: FloatArray
    quaternion: FloatArray
    triangles: NDArray[np.uint32]
    vertices_m: FloatArray

    def surface(self, frame: str) -> SurfaceMesh:
        """The surface, in ``frame``. Raises `MarginGuardError` for one of a wrong size."""
        triangles, vertices = self.triangles, self.vertices_m
        # Before they are copied and checked, which takes longer than their count.
        if not 0 < len(triangles) <= MAX_LIVE_TRIANGLES or len(vertices) > 3 * MAX_LIVE_TRIANGLES:
            raise BridgeError(
                f"the surface has {len(triangles)} triangles and {len(vertices)} vertices; "
                f"expected 1 to {MAX_LIVE_TRIANGLES} triangles in a live session: reduce its "
                "resolution"
            )
        return SurfaceMesh(frame, messages.MM_PER_M * vertices, triangles.astype(np.int64))

    def pose(self, frame: str) -> Transform:
        """The pose of ``frame`` in ``frame_id``."""
        return Transform.from_quaternion(
            tuple(self.quaternion.tolist()),
            messages.MM_PER_M * self.position_m,
            target=self.frame_id,
            source=frame,
        )


@dataclass(frozen=True, slots=True, eq=False)
class StructureRequest(SurfaceRequest):
    """The content of a `SetStructure.Request`; distances and ``sigma_m`` in m."""

    name: str
    role: str
    stop_m: float
    warn_m: float
    sigma_m: float

    def structure(self) -> StructureContent:
        """The structure in mm. Raises `InputError` for another role, and as `surface`."""
        role = role_of(self.role)
        stop_mm, warn_mm, sigma_mm = (
            messages.MM_PER_M * each for each in (self.stop_m, self.warn_m, self.sigma_m)
        )
        return StructureContent(self.surface(self.name), role, stop_mm, warn_mm, sigma_mm)


_SurfaceValues = tuple[str, FloatArray, FloatArray, NDArray[Any], NDArray[Any]]


class _Array(ctypes.Structure):  # a string or a sequence
    _fields_ = [("data", ctypes.c_void_p), ("size", ctypes.c_size_t), ("room", ctypes.c_size_t)]


class _Surface(ctypes.Structure):
    _fields_ = [
        ("sec", ctypes.c_int32),
        ("nanosec", ctypes.c_uint32),
        ("frame_id", _Array),
        ("pose", ctypes.c_double * 7),
        ("triangles", _Array),  # of uint32[3]
        ("vertices", _Array),  # of double[3]
    ]


class _Structure(_Surface):
    _fields_ = [("name", _Array), ("role", _Array), ("distances", ctypes.c_double * 3)]


def _surface_request(address: int) -> SurfaceRequest:
    return SurfaceRequest(*_surface_values(_Surface.from_address(address)))


def _structure_request(address: int) -> StructureRequest:
    request = _Structure.from_address(address)
    name, role = _text(request.name), _text(request.role)
    stop_m, warn_m, sigma_m = request.distances
    return StructureRequest(*_surface_values(request), name, role, stop_m, warn_m, sigma_m)


def _surface_values(request: _Surface) -> _SurfaceValues:
    pose = np.array(request.pose)
    return (
        _text(request.frame_id),
        pose[:3],
        pose[3:],
        _rows(request.triangles, np.uint32),
        _rows(request.vertices, np.float64),
    )


def _text(text: _Array) -> str:
    return ctypes.string_at(text.data, text.size).decode("utf-8", "replace")


def _rows(sequence: _Array, dtype: Any) -> NDArray[Any]:
    rows = np.empty((sequence.size, 3), dtype=dtype)
    ctypes.memmove(rows.ctypes.data, sequence.data, rows.nbytes)  # releases the GIL
    return rows


_new_capsule = ctypes.pythonapi.PyCapsule_New
_new_capsule.restype = ctypes.py_object
_new_capsule.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p]

_Converter = ctypes.PYFUNCTYPE(ctypes.py_object, ctypes.c_void_p)
_to_surface, _to_structure = _Converter(_surface_request), _Converter(_structure_request)


def _capsule(converter: Any) -> Any:
    return _new_capsule(ctypes.cast(converter, ctypes.c_void_p), None, None)


for _kind in (SetTumor, SetStructure):
    _kind.Request.__class__.__import_type_support__()


class _TumorType(type(SetTumor.Request)):  # type: ignore[misc]  # built by rosidl
    """The type support of the request, with another conversion to Python."""

    _CONVERT_TO_PY = _capsule(_to_surface)


class _StructureType(type(SetStructure.Request)):  # type: ignore[misc]  # built by rosidl
    """The type support of the request, with another conversion to Python."""

    _CONVERT_TO_PY = _capsule(_to_structure)


class ArrayRequest(SetTumor.Request, metaclass=_TumorType):  # type: ignore[misc]
    """A `SetTumor.Request` that rclpy receives as a `SurfaceRequest`.

    rclpy converts a message element by element while it holds the GIL: 1 s for 300 000 triangles,
    during which no constraint is sent. This type replaces that conversion by copies of the two
    arrays. The layout of the C structures is the one that rosidl_generator_c defines.
    """


class StructureArrayRequest(SetStructure.Request, metaclass=_StructureType):  # type: ignore[misc]
    """A `SetStructure.Request` that rclpy receives as a `StructureRequest`, as `ArrayRequest`."""
