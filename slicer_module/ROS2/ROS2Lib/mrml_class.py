"""Class names and type tests of SlicerROS2's compiled classes, for nodes written in Python."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from slicer import vtkMRMLNode as _Node
else:
    _Node = object  # at run time the MRML class beside it in the bases is the node


class MrmlClass(_Node):
    """The scene's C++ code uses the name of the MRML base class instead."""

    def GetClassName(self) -> str:
        """Class name as in SlicerROS2."""
        return type(self).__name__

    def GetNodeTagName(self) -> str:
        """Tag of the node in a scene saved by SlicerROS2."""
        return tag_name(type(self).__name__)

    def IsA(self, name: str) -> bool:
        """True for the class name of SlicerROS2, and for those of all base classes."""
        return any(each.__name__ == name for each in type(self).__mro__) or bool(super().IsA(name))

    @classmethod
    def SafeDownCast(cls, node: Any) -> Any:
        """``node`` if it is of this class; otherwise None."""
        return node if isinstance(node, cls) else None


def tag_name(class_name: str) -> str:
    """``vtkMRMLROS2PublisherPoseNode`` as ``ROS2PublisherPose``."""
    short = class_name.removeprefix("vtkMRML").removesuffix("Node")
    return {"ROS2Node": "ROS2Node", "ROS2Robot": "ROS2RobotNode"}.get(short, short)
