"""Publisher of model nodes as collision objects of MoveIt."""

from typing import Any

from ROS2Lib.collision_model import removal_of_model
from ROS2Lib.errors import Ros2Error
from ROS2Lib.publisher import vtkMRMLROS2PublisherNode

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
