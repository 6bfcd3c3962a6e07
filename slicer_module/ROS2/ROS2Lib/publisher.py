"""Publishers: Slicer values to a topic."""

from collections.abc import Callable
from typing import Any

from app.bridge.convert import TopicPublisher
from ROS2Lib.errors import Ros2Error
from ROS2Lib.member import Owner
from ROS2Lib.topic_node import TopicNode


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
