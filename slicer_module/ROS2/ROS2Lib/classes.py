"""Node classes by the names that scripts use: one for each kind of topic and service."""

from functools import cache
from typing import TypeVar

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
