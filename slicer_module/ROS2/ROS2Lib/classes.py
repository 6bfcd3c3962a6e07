"""Classes of nodes by the names that scripts use: one for each kind of topic and service."""

from functools import cache
from typing import TypeVar

Node = TypeVar("Node")


@cache
def kind_class(base: type[Node], name: str) -> type[Node]:
    """``vtkMRMLROS2PublisherPoseNode`` of its base and ``Pose``, the class's own name, or a type.

    Whether there is such a kind is seen when a node of the class is made.
    """
    prefix = base.__name__.removesuffix("Node")
    if name.startswith(prefix) and name.endswith("Node"):
        name = name.removeprefix(prefix).removesuffix("Node")
    return type(kind_class_name(base, name), (base,), {"KIND": name, "__doc__": base.__doc__})


def kind_class_name(base: type, short: str) -> str:
    """``vtkMRMLROS2PublisherPoseNode``."""
    return f"{base.__name__.removesuffix('Node')}{short.rpartition('/')[2]}Node"
