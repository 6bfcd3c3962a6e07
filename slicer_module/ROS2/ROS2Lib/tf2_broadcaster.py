"""Broadcasts poses of the scene to tf, stamped with their measurement or the present."""

import logging

from slicer import vtkMRMLScriptedModuleNode, vtkMRMLTransformNode
from vtkmodules.vtkCommonMath import vtkMatrix4x4

from app.geometry import MarginGuardError, Stamp
from ROS2Lib.errors import Ros2Error
from ROS2Lib.frame_pair import FramePair
from ROS2Lib.member import Owner
from ROS2Lib.tf2_lookup import vtkMRMLROS2Tf2LookupNode
from ROS2Lib.vtk_values import transform


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
        sample = (transform(pose, self._parent, self._child), stamp)
        self._owner.broadcaster.send([sample])
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
