"""Publishers and subscribers: Slicer values to a topic, and a topic to Slicer values."""

import logging
from array import array
from collections.abc import Callable
from typing import Any

import numpy as np
import yaml
from slicer import vtkMRMLModelNode, vtkMRMLScriptedModuleNode, vtkMRMLVolumeNode
from vtkmodules.vtkCommonCore import vtkVariant

from app.bridge.convert import TopicPublisher, TopicQueue, qos_profile
from app.geometry import MarginGuardError
from ROS2Lib.collision_model import removal_of_model
from ROS2Lib.kinds import Kind, kind_of
from ROS2Lib.member import Owner, Ros2Error, TypedMember, without_events
from ROS2Lib.vtk_values import set_output

_RELIABILITY = {0: "reliable", 1: "reliable", 2: "best_effort"}
_DURABILITY = {0: "volatile", 1: "transient_local", 2: "volatile"}


class TopicNode(TypedMember, vtkMRMLScriptedModuleNode):
    """Base of publishers and subscribers: topic and quality of service."""

    ReliabilitySystemDefault, Reliable, BestEffort = range(3)
    DurabilitySystemDefault, TransientLocal, Volatile = range(3)

    def __init__(self) -> None:
        self.kind: Kind = kind_of(self.KIND)
        self._type = self.kind.type
        self._topic = ""
        self._depth = 10
        self._reliability = self.Reliable
        self._durability = self.Volatile

    def GetTopic(self) -> str:
        """The topic's name as given."""
        return self._topic

    def GetBlankMessage(self) -> Any:
        """An empty value of the kind."""
        return self.kind.blank()

    def GetSlicerType(self) -> str:
        """Class name of the values."""
        blank = self.kind.blank()
        # VTK returns subclasses of some classes, so the Python class name may differ.
        class_name = getattr(blank, "GetClassName", None)
        return type(blank).__name__ if class_name is None else str(class_name())

    def SetQoSHistoryDepth(self, depth: int) -> None:
        """Set the queue depth, before the node is added to a ROS node."""
        self._check_not_added()
        if not isinstance(depth, int):
            raise Ros2Error(f"history depth is {depth!r}; expected an integer")
        qos_profile(depth=depth)
        self._depth = depth

    def SetQoSReliability(self, policy: int) -> None:
        """Set `Reliable`, `BestEffort` or `ReliabilitySystemDefault`, before adding."""
        self._check_not_added()
        if policy not in _RELIABILITY:
            raise Ros2Error(f"reliability is {policy!r}; expected one of {sorted(_RELIABILITY)}")
        self._reliability = policy

    def SetQoSDurability(self, policy: int) -> None:
        """Set `TransientLocal`, `Volatile` or `DurabilitySystemDefault`, before adding."""
        self._check_not_added()
        if policy not in _DURABILITY:
            raise Ros2Error(f"durability is {policy!r}; expected one of {sorted(_DURABILITY)}")
        self._durability = policy

    def GetQoSHistoryDepth(self) -> int:
        """Queue depth."""
        return self._depth

    def GetQoSReliability(self) -> int:
        """Reliability policy."""
        return self._reliability

    def GetQoSDurability(self) -> int:
        """Durability policy."""
        return self._durability

    def settings(self) -> dict[str, Any]:
        """Quality of service."""
        return {
            "depth": self._depth,
            "reliability": self._reliability,
            "durability": self._durability,
        }

    def apply_settings(self, settings: dict[str, Any]) -> None:
        """Set the quality of service."""
        self.SetQoSHistoryDepth(settings["depth"])
        self.SetQoSReliability(settings["reliability"])
        self.SetQoSDurability(settings["durability"])

    def quality(self) -> Any:
        """Quality of service with the chosen settings."""
        return qos_profile(
            depth=self._depth,
            reliability=_RELIABILITY[self._reliability],
            durability=_DURABILITY[self._durability],
        )

    def set_topic(self, prefix: str, topic: str) -> None:
        """Store the topic in name and attributes, which a saved scene keeps."""
        self._topic = topic
        self.SetName(f"{prefix}{topic}")
        self.SetAttribute("ros2.topic", topic)
        self.SetAttribute("ros2.type", self.GetROSType())

    def _check_not_added(self) -> None:
        if self.IsAddedToROS2Node():
            raise Ros2Error(f"{self._topic}: quality of service must be set before it is added")


class vtkMRMLROS2PublisherNode(TopicNode):
    """Publishes with or without subscribers; fills in a stamp of 0 with the present."""

    ROLE = "publisher"

    def __init__(self) -> None:
        super().__init__()
        self._publisher: TopicPublisher | None = None
        self._calls = 0
        self._frame_id = ""

    def SetFrameId(self, frameId: str) -> None:
        """Set the frame of messages with an empty one: clouds, images, bare matrices."""
        self._frame_id = frameId
        self.save_state()

    def GetFrameId(self) -> str:
        """Frame of messages with an empty one."""
        return self._frame_id

    def Publish(self, value: Any) -> int:
        """Publish a value; returns the number of subscribers.

        Raises `MarginGuardError` and publishes nothing for a value of another kind.
        """
        return self.publish_message(lambda: self.kind.write(value))

    def publish_message(self, make: Callable[[], Any]) -> int:
        """Publish the ROS message that ``make`` returns, as `Publish`."""
        self._calls += 1
        if self._publisher is None or self._owner is None:
            raise Ros2Error(f"{self.GetName()}: the publisher is not on a ROS node")
        message = make()
        self._owner.stamp(message, self._frame_id)
        return self._publisher.publish(message)

    def GetNumberOfCalls(self) -> int:
        """Number of calls of `Publish`."""
        return self._calls

    def GetNumberOfMessagesSent(self) -> int:
        """Number of published messages."""
        return 0 if self._publisher is None else self._publisher.count

    def settings(self) -> dict[str, Any]:
        """Quality of service and frame."""
        return {**super().settings(), "frame_id": self._frame_id}

    def apply_settings(self, settings: dict[str, Any]) -> None:
        """Set quality of service and frame."""
        super().apply_settings(settings)
        self.SetFrameId(str(settings["frame_id"]))

    def status(self) -> str:
        """Type and number of messages."""
        return f"{self.GetROSType()}, {self.GetNumberOfMessagesSent()} sent"

    def _start(self, owner: Owner, topic: str) -> None:
        self._publisher = TopicPublisher(owner.ros, self.kind.type, topic, self.quality())
        self.set_topic("ros2:pub:", topic)

    def _stop(self) -> None:
        if self._publisher is not None:
            self._publisher.close()
            self._publisher = None


_SOURCE = "source"


class vtkMRMLROS2PublisherCollisionObjectNode(vtkMRMLROS2PublisherNode):
    """Publishes a model's surface in m, at the model's pose in the scene's world.

    `SetFrameId` names the ROS frame that coincides with the scene's world (RAS), by default
    ``world``. Publishing again replaces the object in MoveIt's planning scene.
    """

    KIND = "CollisionObject"

    def __init__(self) -> None:
        super().__init__()
        self._frame_id = "world"

    def SetSourceNodeID(self, modelID: str | None) -> None:
        """Set the model that `Publish` without an argument publishes; None for no model."""
        self.SetNodeReferenceID(_SOURCE, modelID)

    def GetSourceNodeID(self) -> str | None:
        """MRML ID of the model; None without one."""
        found: str | None = self.GetNodeReferenceID(_SOURCE)
        return found

    def GetSourceNode(self) -> Any:
        """The model; None without one."""
        return self.GetNodeReference(_SOURCE)

    def Publish(self, value: Any = None) -> int:
        """Publish a model node or a message; returns the number of subscribers."""
        return super().Publish(self._chosen(value))

    def PublishRemove(self, model: Any = None) -> int:
        """Remove a model from MoveIt's planning scene; returns the number of subscribers."""
        return self.publish_message(lambda: removal_of_model(self._chosen(model)))

    def _chosen(self, value: Any) -> Any:
        """``value``, or the source node for None."""
        found = self.GetSourceNode() if value is None else value
        if found is None:
            raise Ros2Error(f"{self.GetName()}: no model is given; expected one, or a source node")
        return found


def yaml_text(message: Any) -> str:
    """YAML of ``message`` with its own units (m), in the form of ``ros2 topic echo``."""
    text: str = yaml.safe_dump(_plain(message), sort_keys=False, allow_unicode=True)
    return text


def _plain(value: Any) -> Any:
    if hasattr(value, "get_fields_and_field_types"):
        return {
            field: _plain(getattr(value, field)) for field in value.get_fields_and_field_types()
        }
    if isinstance(value, np.ndarray | array):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    if isinstance(value, bytes):
        return list(value)
    return value.item() if isinstance(value, np.generic) else value


_TARGETS = {"Image": vtkMRMLVolumeNode, "PolyData": vtkMRMLModelNode}


class vtkMRMLROS2SubscriberNode(TopicNode):
    """Subscriber. `Spin` invokes ``ModifiedEvent`` once per message, as the last message.

    Messages wait in a queue of the history's depth; further ones are lost and counted.
    """

    ROLE = "subscriber"

    def __init__(self) -> None:
        super().__init__()
        self._queue: TopicQueue | None = None
        self._raw: bytes | None = None
        self._message: Any = None
        self._count = 0
        self._lost = 0
        self._target = ""

    def GetLastMessage(self, message: Any = None) -> Any:
        """Value of the last message; None before the first.

        With ``message`` (a `vtk.reference`, or a VTK object of the kind) the value is copied into
        it, and the result is True, or False before the first message.

        Raises `MarginGuardError` for a message that cannot be converted: invalid bytes, an integer
        beyond VTK's 32 bits, a quaternion that is no rotation.
        """
        read = self._read()
        value = None if read is None else self.kind.read(read)
        return value if message is None else set_output(message, value)

    def GetLastMessageVariant(self) -> vtkVariant:
        """Value of the last message as a vtkVariant, invalid before the first."""
        value = self.GetLastMessage()
        return vtkVariant() if value is None else vtkVariant(value)

    def GetLastMessageYAML(self) -> str:
        """The last message as YAML, lengths in m; empty before the first."""
        message = self._read()
        return "" if message is None else yaml_text(message)

    def GetNumberOfMessages(self) -> int:
        """Number of messages transferred into the scene."""
        return self._count

    def GetNumberOfMessagesLost(self) -> int:
        """Number of messages dropped because the queue was full or the message too long."""
        return self._lost if self._queue is None else self._queue.lost + self._queue.too_long

    def SetTargetNodeID(self, nodeId: str) -> None:
        """Set the volume (Image) or model (PolyData) that shows the newest message; empty: none."""
        target_class = _TARGETS.get(self.KIND)
        if target_class is None:
            raise Ros2Error(f"a {self.KIND} has no target; expected {' or '.join(_TARGETS)}")
        if nodeId and not isinstance(self.GetScene().GetNodeByID(nodeId), target_class):
            raise Ros2Error(f"target {nodeId!r} of {self.GetName()} is no {target_class.__name__}")
        self._target = nodeId
        with without_events(self):
            self.SetNodeReferenceID("target", nodeId or None)

    def GetTargetNodeID(self) -> str:
        """The node that shows the newest message."""
        return self._target

    def status(self) -> str:
        """Type and number of messages."""
        return f"{self.GetROSType()}, {self._count} received"

    def spin(self) -> None:
        """Make each message the last one, in order, with one event each."""
        taken = [] if self._queue is None else self._queue.take()
        for raw in taken:
            if self._queue is None:
                return  # an observer has removed it
            self._raw, self._message = raw, None
            self._count += 1
            self.Modified()
        if taken and self._target and self._queue is not None:
            self._show()

    def _read(self) -> Any:
        if self._message is None and self._raw is not None and self._queue is not None:
            self._message = self._queue.read(self._raw)
        return self._message

    def _show(self) -> None:
        target = self.GetScene().GetNodeByID(self._target)
        if target is None:
            self._target = ""
            return
        try:
            value = self.GetLastMessage()
        except MarginGuardError as error:
            logging.error(f"{self.GetName()}: {error}")
            return
        if self.KIND == "Image":
            target.SetAndObserveImageData(value)
        else:
            target.SetAndObservePolyData(value)

    def _start(self, owner: Owner, topic: str) -> None:
        self._queue = TopicQueue(owner.ros, self.kind.type, topic, self.quality(), owner.wake)
        self.set_topic("ros2:sub:", topic)

    def _stop(self) -> None:
        if self._queue is not None:
            self._read_last()
            self._lost = self.GetNumberOfMessagesLost()
            self._queue.close()
            self._queue = None

    def _read_last(self) -> None:
        """Deserialise the last message, so that it stays readable after removal."""
        try:
            self._read()
        except MarginGuardError:
            self._raw = None
