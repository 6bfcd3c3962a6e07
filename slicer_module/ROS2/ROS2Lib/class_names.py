"""Node and message classes of this module by the names of SlicerROS2."""

from collections.abc import Iterator
from contextlib import suppress
from typing import Any

from app.bridge.ros_errors import UnknownTypeError
from ROS2Lib.bool_string import vtkBoolString
from ROS2Lib.classes import kind_class
from ROS2Lib.errors import Ros2Error
from ROS2Lib.kinds import SERVICES, TOPICS, kind_of, service_kind
from ROS2Lib.node import vtkMRMLROS2NodeNode
from ROS2Lib.parameter import vtkMRMLROS2ParameterNode
from ROS2Lib.publisher import vtkMRMLROS2PublisherNode
from ROS2Lib.robot import vtkMRMLROS2RobotNode
from ROS2Lib.ros_message import RosMessage, classes_within
from ROS2Lib.service_client import vtkMRMLROS2ServiceClientNode
from ROS2Lib.subscriber import vtkMRMLROS2SubscriberNode
from ROS2Lib.tf2_broadcaster import vtkMRMLROS2Tf2BroadcasterNode
from ROS2Lib.tf2_lookup import vtkMRMLROS2Tf2LookupNode

CLASSES = (
    vtkMRMLROS2NodeNode,
    vtkMRMLROS2ParameterNode,
    vtkMRMLROS2RobotNode,
    vtkMRMLROS2Tf2BroadcasterNode,
    vtkMRMLROS2Tf2LookupNode,
)
FAMILIES = (
    vtkMRMLROS2PublisherNode,
    vtkMRMLROS2SubscriberNode,
    vtkMRMLROS2ServiceClientNode,
)


def node_class(name: str) -> type:
    """Node class by its name in SlicerROS2; raises `Ros2Error` for an unknown name."""
    for each in CLASSES:
        if name == each.__name__:
            return each
    for base in FAMILIES:
        prefix = base.__name__.removesuffix("Node")
        if name.startswith(prefix) and name.endswith("Node") and name != base.__name__:
            return kind_class(base, name)
    raise Ros2Error(f"{name!r} is no class of the ROS2 module")


def register_classes(namespace: Any) -> None:
    """Add all classes to ``namespace`` (``slicer``), where scripts expect those of C++ modules.

    Besides the nodes these are the base classes of publishers, subscribers and service clients, and
    the classes of their messages with constructors and constants (``vtkStdMsgsHeader``). Kinds
    whose ROS packages are not installed have no message classes.
    """
    for each in (*CLASSES, *FAMILIES, vtkBoolString):
        setattr(namespace, each.__name__, each)
    for base, names in zip(FAMILIES, (TOPICS, TOPICS, SERVICES), strict=True):
        for name in names:
            made = kind_class(base, name)
            setattr(namespace, made.__name__, made)
    for message in _message_classes():
        setattr(namespace, message.__name__, message)


def _message_classes() -> Iterator[type[RosMessage]]:
    for name in TOPICS:
        with suppress(UnknownTypeError):
            yield from classes_within(kind_of(name).type)
    for name in SERVICES:
        with suppress(UnknownTypeError):
            kind = service_kind(name)
            yield from (*classes_within(kind.Request), *classes_within(kind.Response))
