"""Parent and child frame of a tf member, which are set before it is added to a ROS node."""

import logging

from app.geometry import MarginGuardError, check_frame
from ROS2Lib.member import Member, Owner


class FramePair(Member):
    """Base of lookups and broadcasters."""

    PREFIX = ""
    _parent = ""
    _child = ""

    def GetParentID(self) -> str:
        """The parent's frame."""
        return self._parent

    def GetChildID(self) -> str:
        """The child's frame."""
        return self._child

    def SetParentID(self, parentID: str) -> bool:
        """Set the parent's frame; False, with a log line, if it is invalid or too late for it."""
        if not self._may_set(parentID):
            return False
        self.set_frames(parentID, self._child)
        return True

    def SetChildID(self, childID: str) -> bool:
        """Set the child's frame; False, with a log line, if it is invalid or too late for it."""
        if not self._may_set(childID):
            return False
        self.set_frames(self._parent, childID)
        return True

    def IsParentAndChildSet(self) -> bool:
        """True if both frames are set."""
        return bool(self._parent and self._child)

    def AddToROS2Node(self, nodeId: str, *names: str) -> bool:
        """Call `Member.AddToROS2Node`; without names with the frames that were set before."""
        if not names and not self.IsParentAndChildSet():
            logging.error(f"{self.GetName()}: parent or child is not set; expected both frames")
            return False
        return super().AddToROS2Node(nodeId, *(names or (self._parent, self._child)))

    @classmethod
    def key(cls, owner: Owner, *names: str) -> tuple[str, ...]:
        """Parent and child."""
        parent, child = names
        return (check_frame(parent), check_frame(child))

    def set_frames(self, parent: str, child: str) -> None:
        """Set both frames, and the name by which scripts find the node."""
        self._parent, self._child = parent, child
        self.SetName(f"{self.PREFIX}{parent}To{child}")

    def _may_set(self, frame: str) -> bool:
        if self.IsAddedToROS2Node():
            logging.error(f"{self.GetName()}: frames must be set before it is added to a ROS node")
            return False
        try:
            check_frame(frame)
        except MarginGuardError as error:
            logging.error(f"{self.GetName()}: {error}")
            return False
        return True
