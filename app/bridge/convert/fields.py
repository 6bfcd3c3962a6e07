"""Codecs that read a field of a message as a plain value and write it back, and their unit scales.

The table has the scales, per field, between messages (m) and plain values (mm).
A type is scaled wherever it occurs, also nested: `Point` in `Pose`, `Pose` in `PoseArray`, and so
on. `Vector3` has no unit of its own; the message that contains it defines it. An entry for a field
applies to everything in that field and overrides the entry of the field's type (an `ImageMarker`
has points in pixels).

Radians, seconds, newtons, newton metres, colours and plain numbers are not scaled. `JointState` and
`JointTrajectory` are not scaled either: their numbers are rad or m depending on the joint. The
bytes of `Image` and `PointCloud2` are unchanged; `cloud_points_mm` converts points.

SlicerROS2 differs: it scales the translations of `Pose` and `Transform` but leaves points, vectors
and twists in m.
"""

import math
from array import array
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosidl_parser.definition import AbstractType, AbstractWString

from app.bridge.messages import MM_PER_M
from app.bridge.ros_errors import ConversionError

Scale = float | tuple[float, ...]
"""Factor from the message's unit to ours: one for all numbers of the field, or one per number."""

_UNSCALED = 1.0


_POSE_UNITS = (MM_PER_M,) * 3 + (_UNSCALED,) * 3
_POSE_COVARIANCE = tuple(row * column for row in _POSE_UNITS for column in _POSE_UNITS)
"""Scales of a 6 x 6 covariance, row by row: three lengths, then three angles."""
_LINEAR_COVARIANCE = (MM_PER_M**2,) * 9

SCALES: Mapping[str, Mapping[str, Scale]] = MappingProxyType(
    {
        "geometry_msgs/msg/Point": {"x": MM_PER_M, "y": MM_PER_M, "z": MM_PER_M},
        "geometry_msgs/msg/Point32": {"x": MM_PER_M, "y": MM_PER_M, "z": MM_PER_M},
        "geometry_msgs/msg/Pose2D": {"x": MM_PER_M, "y": MM_PER_M},
        "geometry_msgs/msg/PoseWithCovariance": {"covariance": _POSE_COVARIANCE},
        "geometry_msgs/msg/Transform": {"translation": MM_PER_M},
        "geometry_msgs/msg/Twist": {"linear": MM_PER_M},
        "geometry_msgs/msg/TwistWithCovariance": {"covariance": _POSE_COVARIANCE},
        "geometry_msgs/msg/Accel": {"linear": MM_PER_M},
        "geometry_msgs/msg/AccelWithCovariance": {"covariance": _POSE_COVARIANCE},
        "geometry_msgs/msg/Inertia": {"com": MM_PER_M},
        "sensor_msgs/msg/Imu": {
            "linear_acceleration": MM_PER_M,
            "linear_acceleration_covariance": _LINEAR_COVARIANCE,
        },
        "sensor_msgs/msg/LaserEcho": {"echoes": MM_PER_M},
        "sensor_msgs/msg/LaserScan": {
            "range_min": MM_PER_M,
            "range_max": MM_PER_M,
            "ranges": MM_PER_M,
        },
        "sensor_msgs/msg/MultiEchoLaserScan": {"range_min": MM_PER_M, "range_max": MM_PER_M},
        "sensor_msgs/msg/Range": {
            "min_range": MM_PER_M,
            "max_range": MM_PER_M,
            "range": MM_PER_M,
            "variance": MM_PER_M**2,
        },
        "shape_msgs/msg/Plane": {"coef": (_UNSCALED, _UNSCALED, _UNSCALED, MM_PER_M)},
        "shape_msgs/msg/SolidPrimitive": {"dimensions": MM_PER_M},
        "stereo_msgs/msg/DisparityImage": {"t": MM_PER_M},
        "nav_msgs/msg/GridCells": {"cell_width": MM_PER_M, "cell_height": MM_PER_M},
        "nav_msgs/msg/MapMetaData": {"resolution": MM_PER_M},
        "visualization_msgs/msg/Marker": {"scale": MM_PER_M},
        "visualization_msgs/msg/InteractiveMarker": {"scale": MM_PER_M},
        "visualization_msgs/msg/ImageMarker": {
            "position": _UNSCALED,
            "points": _UNSCALED,
        },
        "moveit_msgs/msg/PositionConstraint": {"target_point_offset": MM_PER_M},
        "moveit_msgs/msg/VisibilityConstraint": {"target_radius": MM_PER_M},
        "moveit_msgs/srv/GetCartesianPath_Request": {
            "max_step": MM_PER_M,
            "prismatic_jump_threshold": MM_PER_M,
            "max_cartesian_speed": MM_PER_M,
        },
        "marginguard_msgs/msg/HalfSpace": {"offset": MM_PER_M, "tumor_velocity": MM_PER_M},
        "marginguard_msgs/msg/FixtureConstraint": {
            "free_distance": MM_PER_M,
            "max_tool_speed": MM_PER_M,
            "signed_distance": MM_PER_M,
            "lower_bound": MM_PER_M,
            "stop_distance": MM_PER_M,
            "warn_distance": MM_PER_M,
            "sigma_tre": MM_PER_M,
        },
        "marginguard_msgs/srv/Register_Response": {"fre": MM_PER_M},
        "marginguard_msgs/srv/NeedleCorridors_Request": dict.fromkeys(
            ("entry_radius", "length", "diameter", "bend", "sigma"), MM_PER_M
        ),
        "marginguard_msgs/action/Plan_Goal": {"clearance": MM_PER_M},
        "marginguard_msgs/action/Replay_Result": {"min_signed_distance": MM_PER_M},
        "marginguard_msgs/action/Replay_Feedback": {"signed_distance": MM_PER_M},
    }
)


NUMBERS = {
    # ROS type: type code of array.array and numpy
    "float": "f",
    "double": "d",
    "int8": "b",
    "uint8": "B",
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "int64": "q",
    "uint64": "Q",
}
_FLOATS = ("float", "double")
_LARGEST_FLOAT32 = float(np.finfo(np.float32).max)

SizeCheck = Callable[[int, str], None]
"""``check(count, name)`` raises `ConversionError` if the field cannot hold ``count`` values."""


@dataclass(frozen=True, slots=True)
class FieldCodec:
    """``read(value)`` gives the plain value; ``write(plain, name)`` goes back and checks it.

    ``name`` is the field's name for error messages.
    """

    read: Callable[[Any], Any]
    write: Callable[[Any, str], Any]


def basic_codec(kind: str, scale: Scale | None) -> FieldCodec:
    """Codec of a single number, boolean or byte."""
    if kind in _FLOATS:
        factor = scale if isinstance(scale, float) else 1.0
        return FieldCodec(
            read=lambda value: value * factor,
            write=lambda value, name: _float(value, name, factor, kind),
        )
    if kind == "boolean":
        return FieldCodec(read=bool, write=_bool)
    if kind == "octet":
        return FieldCodec(
            read=lambda value: value[0],
            write=lambda value, name: bytes([_integer(value, name, 0, 255)]),
        )
    if kind in NUMBERS:
        limits = np.iinfo(NUMBERS[kind])
        low, high = int(limits.min), int(limits.max)
        return FieldCodec(read=int, write=lambda value, name: _integer(value, name, low, high))
    raise ConversionError(f"field type {kind} is not supported")


def string_codec(slot: AbstractType) -> FieldCodec:
    """Codec of a string; checks its maximum length and its encoding."""
    max_chars = slot.maximum_size if slot.has_maximum_size() else None
    encoding = "utf-16-le" if isinstance(slot, AbstractWString) else "utf-8"

    def write(value: Any, name: str) -> str:
        if not isinstance(value, str):
            raise ConversionError(f"{name} is {preview(value)}; expected a string")
        if max_chars is not None and len(value) > max_chars:
            raise ConversionError(
                f"{name} has {len(value)} characters; expected at most {max_chars}"
            )
        try:
            value.encode(encoding)
        except UnicodeEncodeError as error:
            raise ConversionError(
                f"{name} is {preview(value)}; expected text that {encoding} can encode"
            ) from error
        return value

    return FieldCodec(read=str, write=write)


def bytes_codec(check: SizeCheck) -> FieldCodec:
    """Codec of octet[]."""

    def write(value: Any, name: str) -> list[bytes]:
        if not isinstance(value, bytes | bytearray):
            raise ConversionError(f"{name} is {preview(value)}; expected bytes")
        check(len(value), name)
        return [bytes([each]) for each in value]

    return FieldCodec(read=b"".join, write=write)


def numbers_codec(kind: str, check: SizeCheck, scale: Scale | None, *, fixed: bool) -> FieldCodec:
    """Codec of an array of numbers, vectorised; ``fixed`` if the type fixes the array's size."""
    code = NUMBERS[kind]
    factor = np.asarray(scale) if scale is not None and kind in _FLOATS else None

    def read(values: Any) -> NDArray[Any]:
        found = np.frombuffer(values, dtype=code) if len(values) else np.empty(0, dtype=code)
        return read_only(found[:] if factor is None else found.astype(np.float64) * factor)

    def write(values: Any, name: str) -> Any:
        numbers = _numbers(values, name, kind)
        check(numbers.size, name)
        if factor is not None:
            numbers = numbers / factor
        numbers = np.ascontiguousarray(_fitting(numbers, name, code))
        if fixed:
            return numbers.copy()
        filled = array(code)
        if numbers.size:
            filled.frombytes(numbers.tobytes())
        return filled

    return FieldCodec(read, write)


def _numbers(values: Any, name: str, kind: str) -> NDArray[Any]:
    """Numbers (n,), flattened row by row."""
    if isinstance(values, bytes | bytearray):
        values = np.frombuffer(values, dtype=np.uint8)
    try:
        found = np.asarray(values)
    except (ValueError, OverflowError) as error:
        raise ConversionError(
            f"{name} is {preview(values)}; expected an array of {kind}"
        ) from error
    if found.size == 0:
        return np.empty(0, dtype=NUMBERS[kind])
    if found.ndim == 0 or found.dtype.kind not in ("iuf" if kind in _FLOATS else "iu"):
        raise ConversionError(f"{name} is {preview(values)}; expected an array of {kind}")
    return found.reshape(-1)


def _fitting(numbers: NDArray[Any], name: str, code: str) -> NDArray[Any]:
    """Convert ``numbers`` to the field's type; raises `ConversionError` if one does not fit."""
    if numbers.dtype == np.dtype(code):
        return numbers
    if code in "fd":
        with np.errstate(over="ignore"):
            converted = numbers.astype(code)
        bad = np.isfinite(numbers) & ~np.isfinite(converted)
    else:
        limits = np.iinfo(code)
        bad = (numbers < limits.min) | (numbers > limits.max)
        converted = numbers.astype(code)
    if bad.any():
        index = int(bad.argmax())
        raise ConversionError(f"{name}[{index}] is {numbers[index]}; out of range of the field")
    return converted


def _float(value: Any, name: str, factor: float, kind: str) -> float:
    if isinstance(value, bool | np.bool_) or not isinstance(
        value, int | float | np.integer | np.floating
    ):
        raise ConversionError(f"{name} is {preview(value)}; expected a number")
    try:
        number = float(value) / factor
    except OverflowError as error:
        raise ConversionError(f"{name} is {preview(value)}; out of range of the field") from error
    if kind == "float" and math.isfinite(number) and abs(number) > _LARGEST_FLOAT32:
        raise ConversionError(f"{name} is {preview(value)}; out of range of a 32-bit float")
    return number


def _integer(value: Any, name: str, low: int, high: int) -> int:
    if isinstance(value, bool | np.bool_) or not isinstance(value, int | np.integer):
        raise ConversionError(f"{name} is {preview(value)}; expected an integer")
    if not low <= value <= high:
        raise ConversionError(f"{name} is {preview(value)}; expected {low} to {high}")
    return int(value)


def _bool(value: Any, name: str) -> bool:
    if not isinstance(value, bool | np.bool_):
        raise ConversionError(f"{name} is {preview(value)}; expected true or false")
    return bool(value)


def read_only(values: NDArray[Any]) -> NDArray[Any]:
    """Mark the array read-only and return it."""
    values.flags.writeable = False
    return values


def preview(value: Any) -> str:
    """Shortened repr of ``value`` for an error message."""
    return f"{value!r:.60}"
