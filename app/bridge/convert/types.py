"""Types of messages, services and actions by their names, as a configuration file has them."""

import re
from importlib import import_module
from types import MappingProxyType
from typing import Any

from app.bridge.convert.errors import UnknownTypeError

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
        "WrenchStamped": "geometry_msgs/msg/WrenchStamped",
        "Joy": "sensor_msgs/msg/Joy",
        "JointState": "sensor_msgs/msg/JointState",
        "UInt8Image": "sensor_msgs/msg/Image",
        "Image": "sensor_msgs/msg/Image",
        "PointCloud": "sensor_msgs/msg/PointCloud",
        "PolyData": "sensor_msgs/msg/PointCloud2",
    }
)
"""The names that users of SlicerROS2 know."""

_PART = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_MARKS = {"msg": "SLOT_TYPES", "srv": "Request", "action": "Goal"}


def message_type(name: str | type) -> type[Any]:
    """``"Pose"``, ``"geometry_msgs/Pose"`` or ``"geometry_msgs/msg/Pose"`` as a class."""
    return _imported(SHORT_NAMES.get(name, name) if isinstance(name, str) else name, "msg")


def service_type(name: str | type) -> type[Any]:
    """``"std_srvs/Trigger"`` or ``"std_srvs/srv/Trigger"`` as a class."""
    return _imported(name, "srv")


def action_type(name: str | type) -> type[Any]:
    """``"marginguard_msgs/Replay"`` or ``"marginguard_msgs/action/Replay"`` as a class."""
    return _imported(name, "action")


def type_name(kind: type) -> str:
    """``geometry_msgs/msg/Pose`` of a class."""
    package, folder, *_ = kind.__module__.split(".")
    return f"{package}/{folder}/{kind.__name__}"


def _imported(name: str | type, folder: str) -> type[Any]:
    if isinstance(name, type):
        if not hasattr(name, _MARKS[folder]):
            raise UnknownTypeError(f"{name.__name__} is no {folder} type of ROS")
        return name
    package, *middle, last = parts = name.split("/") if "/" in name else ["", name]
    if middle not in ([], [folder]) or not all(map(_PART.fullmatch, parts)):
        raise UnknownTypeError(
            f"{name!r} is no name of a {folder} type: PACKAGE/{folder}/Name or PACKAGE/Name wanted"
        )
    try:
        module = import_module(f"{package}.{folder}")
    except ImportError as error:
        raise UnknownTypeError(
            f"{name}: the package {package!r} with a folder {folder!r} is not installed"
        ) from error
    found = getattr(module, last, None)
    if not (isinstance(found, type) and hasattr(found, _MARKS[folder])):
        raise UnknownTypeError(f"{name}: {package} has no such {folder} type")
    return found
