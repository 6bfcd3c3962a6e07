"""Publishers: values of Slicer to a topic."""

from typing import Any

from app.bridge.convert import TopicPublisher
from ROS2Lib.errors import Ros2Error
from ROS2Lib.member import Owner
from ROS2Lib.topic_node import TopicNode


class vtkMRMLROS2PublisherNode(TopicNode):
    """Publishes whether somebody listens or not; a stamp that was left at 0 is made now."""

    ROLE = "publisher"

    def __init__(self) -> None:
        super().__init__()
        self._publisher: TopicPublisher | None = None
        self._calls = 0
        self._frame_id = ""

    def SetFrameId(self, frameId: str) -> None:
        """The frame of messages whose header names none: clouds, images, bare matrices."""
        self._frame_id = frameId

    def GetFrameId(self) -> str:
        """The frame of messages whose header names none."""
        return self._frame_id

    def GetBlankMessage(self) -> Any:
        """A value to be filled in and published."""
        return self.kind.blank()

    def Publish(self, value: Any) -> int:
        """Send a value; gives the number of subscribers.

        Raises `MarginGuardError`, with nothing sent, for a value that is none of the kind.
        """
        self._calls += 1
        if self._publisher is None or self._owner is None:
            raise Ros2Error(f"{self.GetName()}: the publisher is not on a ROS node")
        message = self.kind.write(value)
        self._owner.stamp(message, self._frame_id)
        return self._publisher.publish(message)

    def GetNumberOfCalls(self) -> int:
        """How often `Publish` was called."""
        return self._calls

    def GetNumberOfMessagesSent(self) -> int:
        """How many of the calls have sent a message."""
        return 0 if self._publisher is None else self._publisher.count

    def status(self) -> str:
        """How much it has sent."""
        return f"{self.GetROSType()}, {self.GetNumberOfMessagesSent()} sent"

    def _start(self, owner: Owner, topic: str) -> None:
        self._publisher = TopicPublisher(owner.ros, self.kind.type, topic, self.quality())
        self.named("ros2:pub:", topic)

    def _stop(self) -> None:
        if self._publisher is not None:
            self._publisher.close()
            self._publisher = None
