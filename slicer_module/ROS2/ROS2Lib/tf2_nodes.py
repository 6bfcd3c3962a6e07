"""Nodes of one tf transform: its lookup, shown with its age, and its broadcaster."""

import logging
from typing import Any

from slicer import vtkMRMLLinearTransformNode, vtkMRMLScriptedModuleNode, vtkMRMLTransformNode
from vtkmodules.vtkCommonMath import vtkMatrix4x4

from app.bridge.robot_description import STALE_AFTER_NS, pose_limits
from app.bridge.ros_errors import TfError
from app.bridge.tf import Lookup
from app.geometry import NS_PER_S, Freshness, MarginGuardError, Stamp, check_frame, freshness_of
from app.scene.convert import is_at, vtk_matrix
from ROS2Lib.member import Member, Owner, Ros2Error
from ROS2Lib.vtk_values import transform


class FramePair(Member):
    """Base of lookups and broadcasters: the frames are set before it is added to a ROS node."""

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


MISSING, VALID, STALE = "missing", "valid", "stale"


class vtkMRMLROS2Tf2LookupNode(FramePair, vtkMRMLLinearTransformNode):
    """``parent_from_child`` in mm; a ``TransformModifiedEvent`` per spin, or per new sample.

    Its state is ``missing`` before the first sample, ``valid``, or ``stale``: while tf has no
    answer, or while the oldest of the newest samples along the path is older than
    `GetStaleAfterSeconds` or from the future (`app.bridge.robot_description.pose_limits`). A stale
    node keeps its pose. A node that was moved in the scene is reset by the next `Spin`. The
    attributes ``ros2.state`` and ``ros2.stamp_ns`` (that sample's stamp) hold the values of the
    last `Spin`.
    """

    ROLE = "lookup"
    PREFIX = "ros2:tf2lookup:"

    def __init__(self) -> None:
        self._found: Lookup | None = None
        self._problem = ""
        self._stale_after_ns = STALE_AFTER_NS
        self._always_modified = True
        self._compared = (0, 0)

    def SetModifiedOnLookup(self, always: bool) -> None:
        """Set whether every `Spin` with a pose invokes the event, new or not; default True."""
        self._always_modified = bool(always)
        self.save_state()

    def GetModifiedOnLookup(self) -> bool:
        """True if every `Spin` with a pose invokes the event."""
        return self._always_modified

    def IsDifferentFromLast(self, seconds: int, nanoSeconds: int) -> bool:
        """True if the stamp differs from that of the last call, which it replaces."""
        before, self._compared = self._compared, (int(seconds), int(nanoSeconds))
        return self._compared != before

    def GetState(self) -> str:
        """``missing``, ``valid`` or ``stale`` at this moment, independent of `Spin`."""
        if self._found is None:
            return MISSING
        if self._owner is None or self._problem:
            return STALE
        stamp_ns = self._found.stamp_ns
        if stamp_ns is None:  # static edges alone, which hold at any time
            return VALID
        limits = pose_limits(self._stale_after_ns)
        freshness = freshness_of(stamp_ns, self._owner.now_ns(), limits)
        return VALID if freshness is Freshness.VALID else STALE

    def IsStale(self) -> bool:
        """True unless the pose is valid."""
        return self.GetState() != VALID

    def GetProblem(self) -> str:
        """The reason why tf has no answer; empty if it has one."""
        return self._problem

    def GetStampNanoseconds(self) -> int | None:
        """Stamp of the oldest sample of the pose; None without a sample or for static edges."""
        return None if self._found is None else self._found.stamp_ns

    def GetAgeSeconds(self) -> float | None:
        """Age in s on the node's clock; None before the first sample, 0 for static edges."""
        if self._found is None or self._owner is None:
            return None
        stamp_ns = self._found.stamp_ns
        return 0.0 if stamp_ns is None else (self._owner.now_ns() - stamp_ns) / NS_PER_S

    def SetStaleAfterSeconds(self, seconds: float) -> None:
        """Set the largest age in s of a valid pose."""
        if not seconds > 0.0:
            raise Ros2Error(f"{self.GetName()}: stale after {seconds} s; expected more than 0")
        self._stale_after_ns = round(seconds * NS_PER_S)
        self.save_state()

    def GetStaleAfterSeconds(self) -> float:
        """Largest age in s of a valid pose."""
        return self._stale_after_ns / NS_PER_S

    def settings(self) -> dict[str, Any]:
        """Events and the age limit."""
        return {
            "modified_on_lookup": self._always_modified,
            "stale_after_s": self.GetStaleAfterSeconds(),
        }

    def apply_settings(self, settings: dict[str, Any]) -> None:
        """Set events and the age limit."""
        self.SetModifiedOnLookup(settings["modified_on_lookup"])
        self.SetStaleAfterSeconds(float(settings["stale_after_s"]))

    def status(self) -> str:
        """State and age."""
        age = self.GetAgeSeconds()
        state = self.GetState()
        return state if age is None else f"{state}, {age:.1f} s old"

    def spin(self) -> None:
        """Look up the pose and update the state."""
        if self._owner is None:
            return
        try:
            found = self._owner.buffer.lookup(self._parent, self._child)
            self._problem = ""
        except TfError as error:
            found, self._problem = None, str(error)
        modifying = self.StartModify()
        if found is not None and (self._always_modified or self._is_new(found)):
            self._found = found
            self.SetAttribute("ros2.stamp_ns", str(found.stamp_ns or 0))
            self.SetMatrixTransformToParent(vtk_matrix(found.transform))
        self._update_state_attribute()
        self.EndModify(modifying)

    def _is_new(self, found: Lookup) -> bool:
        """True for another sample, or if the node was moved in the scene."""
        last = self._found
        return (
            last is None
            or last.stamp_ns != found.stamp_ns
            or not is_at(self, vtk_matrix(found.transform))
        )

    def _update_state_attribute(self) -> None:
        state = self.GetState()
        if state != self.GetAttribute("ros2.state"):
            self.SetAttribute("ros2.state", state)

    def _start(self, owner: Owner, parent: str, child: str) -> None:
        self.set_frames(parent, child)
        self._found, self._problem = None, ""
        _ = owner.buffer  # starts listening to tf
        self._update_state_attribute()

    def _stop(self) -> None:
        self._problem = "the lookup was removed"
        self._update_state_attribute()


class vtkMRMLROS2Tf2BroadcasterNode(FramePair, vtkMRMLScriptedModuleNode):
    """``Broadcast(matrix)`` sends ``parent_from_child``, in mm in the scene and m in tf."""

    ROLE = "broadcaster"
    PREFIX = "ros2:tf2broadcaster:"

    def __init__(self) -> None:
        self._count = 0
        self._observed: vtkMRMLTransformNode | None = None
        self._observer = 0

    def GetNumberOfBroadcasts(self) -> int:
        """Number of sent transforms."""
        return self._count

    def Broadcast(
        self, pose: vtkMatrix4x4 | vtkMRMLTransformNode, stampNs: int | None = None
    ) -> bool:
        """Send a matrix, or a transform node's matrix to its parent, in mm.

        ``stampNs`` is the time of measurement. Without it, a lookup node keeps its own stamp and
        any other pose gets the present. Raises `MarginGuardError` and sends nothing for a matrix
        that is not rigid.
        """
        if self._owner is None:
            raise Ros2Error(f"{self.GetName()}: the broadcaster is not on a ROS node")
        stamp_ns = stampNs
        if stamp_ns is None and isinstance(pose, vtkMRMLROS2Tf2LookupNode):
            stamp_ns = pose.GetStampNanoseconds()
        if isinstance(pose, vtkMRMLTransformNode):
            matrix = vtkMatrix4x4()
            pose.GetMatrixTransformToParent(matrix)
            pose = matrix
        stamp = Stamp(self._owner.now_ns() if stamp_ns is None else stamp_ns)
        self._owner.broadcast(transform(pose, self._parent, self._child), stamp)
        self._count += 1
        return True

    def ObserveTransformNode(self, node: vtkMRMLTransformNode | None) -> None:
        """Broadcast ``node`` now and on every change; None ends it."""
        if self._observed is not None:
            self._observed.RemoveObserver(self._observer)
        self._observed = node
        self.SetNodeReferenceID("ObservedTransform", None if node is None else node.GetID())
        if node is not None:
            self._observer = node.AddObserver(
                vtkMRMLTransformNode.TransformModifiedEvent, self._moved
            )
            self._moved(node, "")

    def status(self) -> str:
        """Number of sent transforms."""
        return f"{self._count} sent"

    def _moved(self, node: vtkMRMLTransformNode, _: str) -> None:
        try:
            self.Broadcast(node)
        except MarginGuardError as error:  # nothing catches errors of an observer
            logging.error(f"{self.GetName()}: {error}")

    def _start(self, owner: Owner, parent: str, child: str) -> None:
        if parent == child:
            raise Ros2Error(f"frame {child!r} is its own parent; expected two different frames")
        self.set_frames(parent, child)

    def _stop(self) -> None:
        self.ObserveTransformNode(None)
