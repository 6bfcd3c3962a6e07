"""Look up message, service and action types by name."""

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
