"""Kinds of topics and services by the names that SlicerROS2's scripts use.

A kind is given by its short name (``Pose``), by the class of its node
(``vtkMRMLROS2PublisherPoseNode``), or by its ROS type (``geometry_msgs/msg/Twist``), which may be
any installed type.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from vtkmodules.vtkCommonCore import (
    vtkDoubleArray,
    vtkIntArray,
    vtkPoints,
    vtkTypeUInt8Array,
)
from vtkmodules.vtkCommonDataModel import vtkImageData, vtkPolyData, vtkTable

from app.bridge.convert import (
    cloud_message,
    cloud_points_mm,
    from_plain,
    image_array,
    image_message,
    message_type,
    service_type,
    to_plain,
)
from app.bridge.convert.plain import SHORT_NAMES
from app.geometry import Stamp
from ROS2Lib import vtk_values
from ROS2Lib.collision_model import message_of_model
from ROS2Lib.member import Ros2Error
from ROS2Lib.ros_message import (
    BoolStringResponse,
    RosMessage,
    message_class,
    message_of,
    value_of,
    vtkBoolString,
)

_OF_ROSBAG2 = (
    "Burst",
    "GetRate",
    "IsPaused",
    "Pause",
    "PlayNext",
    "Resume",
    "Seek",
    "SetRate",
    "Snapshot",
    "SplitBagfile",
    "TogglePaused",
)
_OF_MOVEIT = ("GetCartesianPath", "GetPositionFK", "GetPositionIK")

SERVICES = MappingProxyType(
    {
        "Empty": "std_srvs/srv/Empty",
        "SetBool": "std_srvs/srv/SetBool",
        "SetBoolString": "std_srvs/srv/SetBool",
        "Spawn": "turtlesim/srv/Spawn",
        "Trigger": "std_srvs/srv/Trigger",
        **{name: f"rosbag2_interfaces/srv/{name}" for name in _OF_ROSBAG2},
        **{name: f"moveit_msgs/srv/{name}" for name in _OF_MOVEIT},
    }
)
"""Short names of services; `SetBoolString` is SlicerROS2's name for `SetBool`.

The packages of turtlesim, rosbag2 and MoveIt may be missing; their kinds are then refused.
"""

TOPICS = tuple(SHORT_NAMES)


@dataclass(frozen=True, slots=True)
class Kind:
    """A message type and its conversion from and to a Slicer value."""

    type: Any
    read: Callable[[Any], Any]
    write: Callable[[Any], Any]
    blank: Callable[[], Any]


def kind_of(name: str) -> Kind:
    """Kind of a topic; raises `UnknownTypeError`."""
    kind = message_type(name)
    read, write, blank = _SPECIAL.get(name, (None, None, None))
    return Kind(
        kind,
        read or value_of,
        (lambda value: write(kind, value)) if write else (lambda value: message_of(value, kind)),
        blank or (lambda: value_of(kind())),
    )


def service_kind(name: str) -> Any:
    """Type of a service; raises `UnknownTypeError`."""
    return service_type(SERVICES.get(name, name))


def service_classes(name: str) -> tuple[type[RosMessage], type[RosMessage]]:
    """Classes of the requests and the responses of a service; raises `UnknownTypeError`."""
    if name == "SetBoolString":
        return vtkBoolString, BoolStringResponse
    kind = service_kind(name)
    return message_class(kind.Request), message_class(kind.Response)


def _data(message: Any) -> Any:
    return message.data


def _with_data(kind: Any, value: Any) -> Any:
    return from_plain(kind, {"data": value})


def _with_numbers(kind: Any, value: Any) -> Any:
    data = vtk_values.numbers(value)
    dimension = {"label": "x", "size": len(data), "stride": len(data)}
    return from_plain(kind, {"layout": {"dim": [dimension]}, "data": data})


def _with_table(kind: Any, value: Any) -> Any:
    return from_plain(kind, vtk_values.multi_array(value))


def _pixels_of(message: Any) -> NDArray[Any]:
    found = image_array(message)
    if not found.size:
        raise Ros2Error(
            f"an image of {message.width} x {message.height} has no pixels; expected at least one"
        )
    return found


def _read_uint8(message: Any) -> vtkTypeUInt8Array:
    """One tuple per image row, one component per byte."""
    found = _pixels_of(message)
    if found.dtype != np.uint8:
        raise Ros2Error(
            f"an image of encoding {message.encoding} does not consist of bytes; use an Image"
        )
    rows = vtkTypeUInt8Array()
    rows.SetNumberOfComponents(message.width * (found.shape[2] if found.ndim == 3 else 1))
    rows.SetNumberOfTuples(message.height)
    vtk_values.numbers(rows)[:] = found.reshape(-1)
    return rows


def _write_uint8(_: Any, value: Any) -> Any:
    flat = vtk_values.numbers(value)
    return _image(flat.reshape(value.GetNumberOfTuples(), value.GetNumberOfComponents()))


_SWAPPED = MappingProxyType({"bgr8": [2, 1, 0], "bgra8": [2, 1, 0, 3]})
_ENCODINGS = MappingProxyType(
    {
        ("uint8", 2): "mono8",
        ("uint16", 2): "mono16",
        ("int16", 2): "16SC1",
        ("int32", 2): "32SC1",
        ("float32", 2): "32FC1",
        ("float64", 2): "64FC1",
    }
)
_COLOURS = MappingProxyType({3: "rgb8", 4: "rgba8"})


def _read_image(message: Any) -> vtkImageData:
    found = _pixels_of(message)
    order = _SWAPPED.get(message.encoding)
    return vtk_values.image(found if order is None else found[:, :, order])


def _image(pixels: Any) -> Any:
    encoding = _ENCODINGS.get((pixels.dtype.name, pixels.ndim))
    if pixels.ndim == 3 and pixels.dtype == np.uint8:
        encoding = _COLOURS.get(pixels.shape[2])
    if encoding is None:
        raise Ros2Error(
            f"an image {pixels.shape} of {pixels.dtype} has no ROS encoding; "
            "expected one component, or 3 or 4 of uint8"
        )
    return image_message(pixels, encoding, "", Stamp(0))


def _read_points(message: Any) -> vtkPoints:
    each = to_plain(message)["points"]
    rows = [[point[axis] for axis in "xyz"] for point in each]
    return vtk_values.points(np.array(rows, dtype=np.float64).reshape(-1, 3))


def _write_points(kind: Any, value: Any) -> Any:
    rows = vtk_values.positions_mm(value).tolist()
    return from_plain(kind, {"points": [dict(zip("xyz", row, strict=True)) for row in rows]})


_Special = tuple[Callable[[Any], Any], Callable[[Any, Any], Any], Callable[[], Any] | None]

_SPECIAL: dict[str, _Special] = {
    "Empty": (lambda _: "", lambda kind, _: kind(), str),
    "String": (_data, _with_data, str),
    "Bool": (_data, _with_data, bool),
    "Int": (_data, _with_data, int),
    "Double": (_data, _with_data, float),
    "IntArray": (lambda m: vtk_values.array(m.data, vtkIntArray), _with_numbers, vtkIntArray),
    "DoubleArray": (
        lambda m: vtk_values.array(m.data, vtkDoubleArray),
        _with_numbers,
        vtkDoubleArray,
    ),
    "IntTable": (lambda m: vtk_values.table(to_plain(m), vtkIntArray), _with_table, vtkTable),
    "DoubleTable": (
        lambda m: vtk_values.table(to_plain(m), vtkDoubleArray),
        _with_table,
        vtkTable,
    ),
    "UInt8Image": (_read_uint8, _write_uint8, vtkTypeUInt8Array),
    "Image": (_read_image, lambda _, value: _image(vtk_values.pixels(value)), vtkImageData),
    "PointCloud": (_read_points, _write_points, vtkPoints),
    "PolyData": (
        lambda m: vtk_values.cloud(cloud_points_mm(m)),
        lambda _, value: cloud_message(vtk_values.positions_mm(value), "", Stamp(0)),
        vtkPolyData,
    ),
    "CollisionObject": (value_of, message_of_model, None),
}
"""Conversions of short names with a Slicer value of their own: read, write, blank value."""


Node = TypeVar("Node")

_special: dict[tuple[type, str], type] = {}


def special_class(base: type, ros_type: str, made: type) -> None:
    """Let `kind_class` return ``made``, a class with methods of its own, for this kind."""
    package, _, name = ros_type.split("/")
    for each in (name, ros_type, f"{package}/{name}"):
        _special[base, each] = made


@cache
def kind_class(base: type[Node], name: str) -> type[Node]:
    """Subclass of ``base`` for a kind, e.g. ``vtkMRMLROS2PublisherPoseNode`` for ``Pose``.

    ``name`` is a short name, a class name or a ROS type. An unknown kind raises when a node of the
    class is created.
    """
    prefix = base.__name__.removesuffix("Node")
    if name.startswith(prefix) and name.endswith("Node"):
        name = name.removeprefix(prefix).removesuffix("Node")
    found = _special.get((base, name))
    if found is not None:
        return found
    return type(kind_class_name(base, name), (base,), {"KIND": name, "__doc__": base.__doc__})


def kind_class_name(base: type, short: str) -> str:
    """Class name of a kind: ``vtkMRMLROS2PublisherPoseNode`` for ``Pose``."""
    return f"{base.__name__.removesuffix('Node')}{short.rpartition('/')[2]}Node"
