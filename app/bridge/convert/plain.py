"""Conversion between messages of any installed type and plain values in our units.

======================= ==========================================================
message                 plain value
======================= ==========================================================
message                 dict of its fields
bool, integer, string   the same
float                   float, in the unit that `app.bridge.convert.fields` defines
octet, octet[]          int, bytes
bool[], numbers[]       read-only numpy array (n,); float64 if scaled
strings[], messages[]   list
======================= ==========================================================

`from_plain` checks every value against its field. rclpy does not check by default and corrupts an
integer in a float field: ``Float64(data=1)`` arrives as 5e-324.
"""

import re
from collections.abc import Mapping, Sequence
from functools import cache
from importlib import import_module
from types import MappingProxyType
from typing import Any

import numpy as np
from rosidl_parser.definition import (
    AbstractNestedType,
    AbstractType,
    Array,
    BasicType,
    BoundedSequence,
    NamespacedType,
)

from app.bridge.convert.fields import (
    NUMBERS,
    SCALES,
    FieldCodec,
    Scale,
    SizeCheck,
    basic_codec,
    bytes_codec,
    numbers_codec,
    preview,
    read_only,
    string_codec,
)
from app.bridge.ros_errors import ConversionError, UnknownTypeError

SHORT_NAMES = MappingProxyType(
    {
        "Empty": "std_msgs/msg/Empty",
        "String": "std_msgs/msg/String",
        "Bool": "std_msgs/msg/Bool",
        "Int": "std_msgs/msg/Int64",
        "Double": "std_msgs/msg/Float64",
        "IntArray": "std_msgs/msg/Int64MultiArray",
        "DoubleArray": "std_msgs/msg/Float64MultiArray",
        "IntTable": "std_msgs/msg/Int64MultiArray",
        "DoubleTable": "std_msgs/msg/Float64MultiArray",
        "Pose": "geometry_msgs/msg/Pose",
        "PoseStamped": "geometry_msgs/msg/PoseStamped",
        "PoseArray": "geometry_msgs/msg/PoseArray",
        "TransformStamped": "geometry_msgs/msg/TransformStamped",
        "Wrench": "geometry_msgs/msg/Wrench",
        "WrenchStamped": "geometry_msgs/msg/WrenchStamped",
        "Joy": "sensor_msgs/msg/Joy",
        "JointState": "sensor_msgs/msg/JointState",
        "UInt8Image": "sensor_msgs/msg/Image",
        "Image": "sensor_msgs/msg/Image",
        "PointCloud": "sensor_msgs/msg/PointCloud",
        "PolyData": "sensor_msgs/msg/PointCloud2",
        "CollisionObject": "moveit_msgs/msg/CollisionObject",
    }
)
"""Short names of SlicerROS2. The package of `CollisionObject` may be missing."""

_PART = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_CLASS_MARKS = {"msg": "SLOT_TYPES", "srv": "Request", "action": "Goal"}

Plain = dict[str, Any]


def message_type(name: str | type) -> type[Any]:
    """Class of ``"Pose"``, ``"geometry_msgs/Pose"`` or ``"geometry_msgs/msg/Pose"``."""
    return _imported(SHORT_NAMES.get(name, name) if isinstance(name, str) else name, "msg")


def service_type(name: str | type) -> type[Any]:
    """Class of ``"std_srvs/Trigger"`` or ``"std_srvs/srv/Trigger"``."""
    return _imported(name, "srv")


def action_type(name: str | type) -> type[Any]:
    """Class of ``"marginguard_msgs/Replay"`` or ``"marginguard_msgs/action/Replay"``."""
    return _imported(name, "action")


def type_name(kind: type) -> str:
    """Full name of a message class, such as ``geometry_msgs/msg/Pose``."""
    package, folder, *_ = kind.__module__.split(".")
    return f"{package}/{folder}/{kind.__name__}"


def _imported(name: str | type, folder: str) -> type[Any]:
    if isinstance(name, type):
        if not hasattr(name, _CLASS_MARKS[folder]):
            raise UnknownTypeError(f"{name.__name__} is not a ROS {folder} type")
        return name
    package, *middle, last = parts = name.split("/") if "/" in name else ["", name]
    if middle not in ([], [folder]) or not all(map(_PART.fullmatch, parts)):
        raise UnknownTypeError(
            f"{name!r} is not the name of a {folder} type; expected PACKAGE/{folder}/Name or "
            "PACKAGE/Name"
        )
    try:
        module = import_module(f"{package}.{folder}")
    except ImportError as error:
        raise UnknownTypeError(
            f"{name}: package {package!r} with folder {folder!r} is not installed"
        ) from error
    found = getattr(module, last, None)
    if not (isinstance(found, type) and hasattr(found, _CLASS_MARKS[folder])):
        raise UnknownTypeError(f"{name}: {package} has no such {folder} type")
    return found


def to_plain(message: Any) -> Plain:
    """Convert ``message`` to plain values, with lengths in mm.

    Numpy arrays that are not scaled are views of the message; do not modify it afterwards.
    """
    plain: Plain = _message_codec(message.__class__, None).read(message)
    return plain


def from_plain(kind: str | type, values: Mapping[str, Any]) -> Any:
    """Create a message of type ``kind``, a class or a name; missing fields keep their defaults.

    Raises `ConversionError`, with the name of the field, for a value that does not fit, and
    `UnknownTypeError`.
    """
    found = message_type(kind) if isinstance(kind, str) else kind
    return _message_codec(found, None).write(values, found.__name__)


@cache
def _message_codec(kind: Any, forced: float | None) -> FieldCodec:
    """Codec of a message type; ``forced`` is the scale of all its numbers, set by the parent."""
    table = SCALES.get(type_name(kind), {})
    codecs: dict[str, FieldCodec] = {}
    for field, slot in zip(
        kind.get_fields_and_field_types(),
        kind.SLOT_TYPES,
        strict=True,
    ):
        scale = table.get(field) if forced is None else forced
        codecs[field] = _field_codec(slot, scale)

    def read(message: Any) -> Plain:
        return {field: codec.read(getattr(message, field)) for field, codec in codecs.items()}

    def write(values: Any, name: str) -> Any:
        if isinstance(values, kind):
            values = read(values)
        if not isinstance(values, Mapping):
            raise ConversionError(f"{name} is {preview(values)}; expected a mapping of its fields")
        message = kind()
        for field, value in values.items():
            codec = codecs.get(field)
            if codec is None:
                raise ConversionError(
                    f"{name} has no field {field!r}; expected one of {', '.join(codecs)}"
                )
            setattr(message, field, codec.write(value, f"{name}.{field}"))
        return message

    return FieldCodec(read, write)


def _field_codec(slot: AbstractType, scale: Scale | None) -> FieldCodec:
    if isinstance(slot, NamespacedType):
        if isinstance(scale, tuple):
            raise ConversionError(
                f"unit of {slot.name} is {scale}; expected one scale for a nested message"
            )
        return _message_codec(getattr(import_module(".".join(slot.namespaces)), slot.name), scale)
    if isinstance(slot, AbstractNestedType):
        return _sequence_codec(slot, scale)
    if isinstance(slot, BasicType):
        return basic_codec(slot.typename, scale)
    return string_codec(slot)


def _sequence_codec(slot: AbstractNestedType, scale: Scale | None) -> FieldCodec:
    item = slot.value_type
    check = _size_check(slot)
    if isinstance(item, BasicType) and item.typename in NUMBERS:
        return numbers_codec(item.typename, check, scale, fixed=isinstance(slot, Array))
    if isinstance(item, BasicType) and item.typename == "octet":
        return bytes_codec(check)
    codec = _field_codec(item, scale)

    def write(values: Any, name: str) -> list[Any]:
        if isinstance(values, str | bytes | Mapping) or not isinstance(
            values, Sequence | np.ndarray
        ):
            raise ConversionError(f"{name} is {preview(values)}; expected a list")
        check(len(values), name)
        return [codec.write(value, f"{name}[{index}]") for index, value in enumerate(values)]

    if isinstance(item, BasicType):
        return FieldCodec(read=lambda values: read_only(np.array(values, dtype=bool)), write=write)
    return FieldCodec(read=lambda values: [codec.read(value) for value in values], write=write)


def _size_check(slot: AbstractNestedType) -> SizeCheck:
    fixed = slot.size if isinstance(slot, Array) else None
    max_count = slot.maximum_size if isinstance(slot, BoundedSequence) else None

    def check(count: int, name: str) -> None:
        if fixed is not None and count != fixed:
            raise ConversionError(f"{name} has {count} values; expected {fixed}")
        if max_count is not None and count > max_count:
            raise ConversionError(f"{name} has {count} values; expected at most {max_count}")

    return check
