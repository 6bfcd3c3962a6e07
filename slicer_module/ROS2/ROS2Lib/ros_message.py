"""Messages with ``Get`` and ``Set`` for each field, and VTK values for geometric types.

A pose or a transform is a vtkMatrix4x4 in mm; a wrench, a twist or an acceleration an array of
six values; a list is a tuple. `app.bridge.convert` scales lengths field by field.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np
from rosidl_parser.definition import AbstractNestedType, AbstractType, NamespacedType
from std_srvs.srv import SetBool
from vtkmodules.vtkCommonTransforms import vtkTransform, vtkTransformCollection

from app.bridge.convert import from_plain, to_plain, type_name
from ROS2Lib import vtk_values
from ROS2Lib.member import Ros2Error

Plain = Mapping[str, Any]


class RosMessage:
    """``message.GetHeader().SetFrameId("tool")``: the field ``frame_id`` becomes ``FrameId``.

    Base of one class per ROS type (`message_class`), which has the type's constants as attributes.
    """

    KIND: Any = None

    def __init__(self, values: dict[str, Any] | None = None) -> None:
        """A blank message; ``values`` by field name are used as they are."""
        if self.KIND is None:
            raise Ros2Error("RosMessage has no ROS type; expected one of its subclasses")
        if values is None:
            values = _field_values(to_plain(self.KIND()), self.KIND)
        self._values = values
        self._fields = {camel(field): field for field in values}

    @classmethod
    def GetClassName(cls) -> str:
        """Class name as in SlicerROS2: ``vtkGeometryMsgsPoseStamped``."""
        return cls.__name__

    def IsA(self, name: str) -> bool:
        """True for the names of its class and their base classes."""
        return any(each.__name__ == name for each in type(self).__mro__) or name == "vtkObject"

    @classmethod
    def SafeDownCast(cls, value: Any) -> Any:
        """``value`` if it is of this class; otherwise None."""
        return value if isinstance(value, cls) else None

    def NewInstance(self) -> Any:
        """A blank message of the same class."""
        return type(self)()

    def DeepCopy(self, other: Any) -> None:
        """Become a copy of a message of the same type; raises `Ros2Error` for another."""
        self.take(message_of(other, self.KIND))

    def take(self, message: Any) -> None:
        """Become the value of a ROS message of its type."""
        self._values = _field_values(to_plain(message), self.KIND)

    def __getattr__(self, name: str) -> Callable[..., Any]:
        field = self.__dict__.get("_fields", {}).get(name[3:])
        if field is None or name[:3] not in ("Get", "Set"):
            raise AttributeError(
                f"{type(self).__name__} has no {name}; "
                f"expected Get or Set of one of {', '.join(self.__dict__.get('_fields', ()))}"
            )
        if name[:3] == "Get":
            return lambda: self._values[field]

        def put(value: Any) -> None:
            self._values[field] = value

        return put

    def __dir__(self) -> Iterable[str]:
        each = (f"{prefix}{field}" for field in self._fields for prefix in ("Get", "Set"))
        return (*super().__dir__(), *each)

    def __repr__(self) -> str:
        shown = ", ".join(f"{field}={value!r}" for field, value in self._values.items())
        return f"{self.KIND.__name__}({shown})"


@cache
def message_class(kind: Any) -> type[RosMessage]:
    """Class of the messages of a ROS type, named as in SlicerROS2, with the type's constants."""
    package, _, name = type_name(kind).split("/")
    # rosidl keeps the constants in the private dictionary of the type's metaclass.
    constants = getattr(type(kind), f"_{type(kind).__name__}__constants", {})
    members = {"KIND": kind, "__doc__": f"A ``{type_name(kind)}`` in the scene's units."}
    return type(f"vtk{camel(package)}{camel(name)}", (RosMessage,), {**constants, **members})


def classes_within(kind: Any) -> set[type[RosMessage]]:
    """Classes of the messages of a ROS type and of all types it contains."""
    found: set[type[RosMessage]] = set()
    waiting = [kind]
    while waiting:
        kind = waiting.pop()
        made = message_class(kind)
        if made in found:
            continue
        found.add(made)
        for slot in kind.SLOT_TYPES:
            inner = slot.value_type if isinstance(slot, AbstractNestedType) else slot
            if isinstance(inner, NamespacedType):
                waiting.append(_class(inner))
    return found


def value_of(message: Any) -> Any:
    """Slicer value of a ROS message, lengths in mm."""
    return _value(to_plain(message), type(message))


def message_of(value: Any, kind: type) -> Any:
    """A ROS message of ``kind`` from its value or from a mapping of fields, lengths in mm.

    A type that adds only a header also accepts the bare content: a PoseStamped a matrix, a
    PoseArray a vtkTransformCollection. Raises `Ros2Error` for another type.
    """
    return from_plain(kind, _plain(value, kind))


def camel(name: str) -> str:
    """``child_frame_id`` as ``ChildFrameId``."""
    return "".join(part[:1].upper() + part[1:] for part in name.split("_"))


@dataclass(frozen=True, slots=True)
class _Equivalent:
    """Conversion between the fields of a type, in mm, and a VTK value."""

    value: Callable[[Plain], Any]
    plain: Callable[[Any], Plain]


def _pose(translation: str, rotation: str) -> _Equivalent:
    return _Equivalent(
        value=lambda plain: vtk_values.matrix(plain[translation], plain[rotation]),
        plain=lambda value: dict(
            zip((translation, rotation), vtk_values.translation_and_rotation(value), strict=True)
        ),
    )


def _two_vectors(first: str, second: str) -> _Equivalent:
    return _Equivalent(
        value=lambda plain: vtk_values.six_array(plain[first], plain[second]),
        plain=lambda value: dict(zip((first, second), vtk_values.two_vectors(value), strict=True)),
    )


_EQUIVALENTS = {
    "geometry_msgs/msg/Pose": _pose("position", "orientation"),
    "geometry_msgs/msg/Transform": _pose("translation", "rotation"),
    "geometry_msgs/msg/Wrench": _two_vectors("force", "torque"),
    "geometry_msgs/msg/Twist": _two_vectors("linear", "angular"),
    "geometry_msgs/msg/Accel": _two_vectors("linear", "angular"),
}


def _value(plain: Plain, kind: Any) -> Any:
    equivalent = _EQUIVALENTS.get(type_name(kind))
    if equivalent is not None:
        return equivalent.value(plain)
    return message_class(kind)(_field_values(plain, kind))


def _field_values(plain: Plain, kind: Any) -> dict[str, Any]:
    return {field: _field_value(plain[field], slot) for field, slot in _slots(kind)}


def _field_value(plain: Any, slot: AbstractType) -> Any:
    if isinstance(slot, NamespacedType):
        return _value(plain, _class(slot))
    if isinstance(slot, AbstractNestedType) and isinstance(slot.value_type, NamespacedType):
        return tuple(_value(each, _class(slot.value_type)) for each in plain)
    if isinstance(plain, np.ndarray):
        return tuple(plain.tolist())
    return tuple(plain) if isinstance(plain, list) else plain


def _plain(value: Any, kind: Any) -> Plain:
    if isinstance(value, Mapping):
        return value
    equivalent = _EQUIVALENTS.get(type_name(kind))
    if equivalent is not None:
        return equivalent.plain(value)
    slots = dict(_slots(kind))
    if isinstance(value, RosMessage):
        if value.KIND is not kind:
            raise Ros2Error(f"message is a {value.KIND.__name__}; expected a {kind.__name__}")
        return {field: _field_plain(value._values[field], slots[field]) for field in slots}
    if len(slots) == 2 and "header" in slots:
        (field,) = slots.keys() - {"header"}
        return {field: _field_plain(value, slots[field])}
    raise Ros2Error(
        f"value is a {type(value).__name__}; expected a filled-in blank {kind.__name__}"
    )


def _field_plain(value: Any, slot: AbstractType) -> Any:
    if isinstance(slot, NamespacedType):
        return _plain(value, _class(slot))
    if isinstance(slot, AbstractNestedType) and isinstance(slot.value_type, NamespacedType):
        kind = _class(slot.value_type)
        if isinstance(value, vtkTransformCollection):
            each = (value.GetItemAsObject(n) for n in range(value.GetNumberOfItems()))
            value = [item.GetMatrix() for item in each if isinstance(item, vtkTransform)]
        if not isinstance(value, Iterable):
            raise Ros2Error(
                f"value is a {type(value).__name__}; expected a list of {kind.__name__}"
            )
        return [_plain(item, kind) for item in value]
    return value


def _slots(kind: Any) -> list[tuple[str, AbstractType]]:
    return list(zip(kind.get_fields_and_field_types(), kind.SLOT_TYPES, strict=True))


def _class(slot: NamespacedType) -> Any:
    return getattr(import_module(".".join(slot.namespaces)), slot.name)


class vtkBoolString(message_class(SetBool.Request)):  # type: ignore[misc]  # made at run time
    """Request: ``SetResult(True)`` is the field ``data``; the message stays in the scene."""

    _message = ""

    def GetResult(self) -> bool:
        """The value to send."""
        return bool(self.GetData())

    def SetResult(self, result: bool) -> None:
        """Set the value to send."""
        self.SetData(result)

    def GetMessage(self) -> str:
        """Text of the script; it is not sent."""
        return self._message

    def SetMessage(self, message: str) -> None:
        """Keep a text, which is not sent."""
        self._message = message


class BoolStringResponse(message_class(SetBool.Response)):  # type: ignore[misc]  # as above
    """Response: ``GetResult`` is the field ``success``; ``GetMessage`` is a field already."""

    @classmethod
    def GetClassName(cls) -> str:
        """The class name of the request."""
        return "vtkBoolString"

    def IsA(self, name: str) -> bool:
        """True also for SlicerROS2's name."""
        return name == "vtkBoolString" or bool(super().IsA(name))

    def GetResult(self) -> bool:
        """True if the server reports success."""
        return bool(self.GetSuccess())

    def SetResult(self, result: bool) -> None:
        """Set the field ``success``."""
        self.SetSuccess(result)
