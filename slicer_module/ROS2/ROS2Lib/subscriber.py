"""Subscribers: a topic to Slicer values, one event per message."""

import logging
from typing import Any

from slicer import vtkMRMLModelNode, vtkMRMLVolumeNode
from vtkmodules.vtkCommonCore import vtkVariant

from app.bridge.convert import TopicQueue
from app.geometry import MarginGuardError
from ROS2Lib.errors import Ros2Error
from ROS2Lib.member import Owner
from ROS2Lib.output_argument import set_output
from ROS2Lib.saved_state import without_events
from ROS2Lib.topic_node import TopicNode
from ROS2Lib.yaml_text import yaml_text

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
