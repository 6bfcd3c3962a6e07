"""SlicerROS2's messages of ``SetBoolString``, its form of ``std_srvs/srv/SetBool``."""

from std_srvs.srv import SetBool

from ROS2Lib.ros_message import message_class


class vtkBoolString(message_class(SetBool.Request)):  # type: ignore[misc]  # made at run time
    """Request: ``SetResult(True)`` is the field ``data``; the message stays in the scene."""

    _message = ""

    def GetResult(self) -> bool:
        """The value to send."""
        return bool(self.GetData())

    def SetResult(self, result: bool) -> None:
        """Set the value to send."""
        self.SetData(result)

    def GetMessage(self) -> str:
        """Text of the script; it is not sent."""
        return self._message

    def SetMessage(self, message: str) -> None:
        """Keep a text, which is not sent."""
        self._message = message


class BoolStringResponse(message_class(SetBool.Response)):  # type: ignore[misc]  # as above
    """Response: ``GetResult`` is the field ``success``; ``GetMessage`` is a field already."""

    @classmethod
    def GetClassName(cls) -> str:
        """The class name of the request."""
        return "vtkBoolString"

    def IsA(self, name: str) -> bool:
        """True also for SlicerROS2's name."""
        return name == "vtkBoolString" or bool(super().IsA(name))

    def GetResult(self) -> bool:
        """True if the server reports success."""
        return bool(self.GetSuccess())

    def SetResult(self, result: bool) -> None:
        """Set the field ``success``."""
        self.SetSuccess(result)
