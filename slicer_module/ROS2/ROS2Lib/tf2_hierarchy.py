"""Broadcasts a transform of the scene and all transforms below it to tf."""

from typing import Any

from slicer import vtkMRMLLinearTransformNode, vtkMRMLScriptedModuleNode
from vtkmodules.vtkCommonMath import vtkMatrix4x4

from app.bridge.tf_topics import OwnedFrames
from app.geometry import (
    NS_PER_MS,
    NS_PER_S,
    MarginGuardError,
    Stamp,
    Transform,
    check_frame,
    split_transform_name,
)
from app.scene.scene_nodes import is_marked
from ROS2Lib.member import Member, Owner, Ros2Error
from ROS2Lib.tf2_nodes import vtkMRMLROS2Tf2LookupNode
from ROS2Lib.vtk_values import transform

LISTEN_NS = NS_PER_S
"""Nothing is broadcast before, so that frames of other nodes are known."""

REPEAT_NS = 100 * NS_PER_MS
"""Transforms that do not move are repeated, as tf expects it."""


class vtkMRMLROS2Tf2HierarchyNode(Member, vtkMRMLScriptedModuleNode):
    """`ObserveTransformNode` broadcasts a linear transform node and all those below it.

    ``ToolTipToTool`` is the frame ``tool_tip``; a node of another name is the frame of that
    name. The top is placed in the frame with which the member was created. Only what the
    scene owns is sent: no lookup, no transform that MarginGuard or a simulation sets, and no frame
    that another node broadcasts (`GetProblem`).
    """

    ROLE = "hierarchy"

    def __init__(self) -> None:
        self._frames: OwnedFrames | None = None
        self._parent = ""
        self._top: vtkMRMLLinearTransformNode | None = None
        self._began_ns = 0
        self._sent: tuple[int, dict[str, Transform]] = (0, {})
        self._problems: dict[str, str] = {}
        self._count = 0

    def ObserveTransformNode(self, node: vtkMRMLLinearTransformNode | None) -> None:
        """Broadcast ``node`` and all transforms below it from now on; None ends it."""
        self._top = node
        self._sent = 0, {}

    def GetFrames(self) -> list[str]:
        """The frames that were broadcast last, sorted."""
        return sorted(self._sent[1])

    def GetNumberOfBroadcasts(self) -> int:
        """Number of sent messages."""
        return self._count

    def GetProblem(self) -> str:
        """The reasons why transforms of the hierarchy are not broadcast; empty if all are."""
        return "; ".join(self._problems[name] for name in sorted(self._problems))

    def status(self) -> str:
        """Number of frames, and what is not broadcast."""
        text = f"{len(self._sent[1])} frames"
        return f"{text}, not sent: {self.GetProblem()}" if self._problems else text

    def spin(self) -> None:
        """Broadcast what has moved, and all of it when it is due again."""
        owner, frames = self._owner, self._frames
        if owner is None or frames is None:
            return
        now_ns = owner.now_ns()
        if self._top is None or self._top.GetScene() is None or now_ns < self._began_ns + LISTEN_NS:
            return
        self._problems = {}
        poses = self._poses(self._top, self._parent)
        for frame in frames.refused(poses):
            del poses[frame]
            self._problems[frame] = f"frame {frame!r} is broadcast by another node"
        sent_ns, before = self._sent
        is_due = not 0 <= now_ns - sent_ns < REPEAT_NS
        if poses and (is_due or not _are_same(poses, before)):
            frames.send(poses.values(), Stamp(now_ns))
            self._sent = now_ns, poses
            self._count += 1
        elif not poses:
            self._sent = now_ns, {}

    @classmethod
    def key(cls, owner: Owner, *names: str) -> tuple[str, ...]:
        """The parent of the top."""
        (parent,) = names
        return (check_frame(parent),)

    def _poses(self, top: vtkMRMLLinearTransformNode, parent: str) -> dict[str, Transform]:
        """``parent_from_child`` by child, of ``top`` and of what is below it."""
        found: dict[str, Transform] = {}
        below = _children(top)
        waiting = [(top, parent)]
        while waiting:
            node, target = waiting.pop()
            try:
                frame = _frame(node)
                if _is_of_others(node):
                    self._problems[node.GetName()] = f"{node.GetName()} is not set by the scene"
                elif frame in found or frame == parent:
                    raise Ros2Error(f"{node.GetName()}: a second frame {frame!r}; expected one")
                else:
                    matrix = vtkMatrix4x4()
                    node.GetMatrixTransformToParent(matrix)
                    found[frame] = transform(matrix, target, frame)
            except MarginGuardError as error:
                self._problems[node.GetName()] = f"{node.GetName()}: {error}"
                continue  # what is below it has no parent on tf
            waiting.extend((each, frame) for each in below.get(node.GetID(), []))
        return found

    def _start(self, owner: Owner, parent: str) -> None:
        self.SaveWithSceneOff()  # loading a scene publishes nothing
        self._parent = parent
        self.SetName(f"ros2:tf2hierarchy:{parent}")
        self._frames = OwnedFrames(owner.ros)
        self._began_ns = owner.now_ns()

    def _stop(self) -> None:
        self.ObserveTransformNode(None)
        if self._frames is not None:
            self._frames.close()
        self._frames = None


def _children(top: vtkMRMLLinearTransformNode) -> dict[str, list[Any]]:
    """Linear transform nodes of the scene by the MRML ID of their parent."""
    found: dict[str, list[Any]] = {}
    nodes = top.GetScene().GetNodesByClass("vtkMRMLLinearTransformNode")
    for index in range(nodes.GetNumberOfItems()):
        node = nodes.GetItemAsObject(index)
        found.setdefault(node.GetTransformNodeID() or "", []).append(node)
    return found


def _frame(node: Any) -> str:
    if isinstance(node, vtkMRMLROS2Tf2LookupNode):
        return node.GetChildID()
    names = split_transform_name(node.GetName())
    return check_frame(node.GetName() if names is None else names[0])


def _is_of_others(node: Any) -> bool:
    return isinstance(node, vtkMRMLROS2Tf2LookupNode) or is_marked(node)


def _are_same(poses: dict[str, Transform], before: dict[str, Transform]) -> bool:
    return poses.keys() == before.keys() and all(
        pose.target == before[frame].target and (pose.matrix == before[frame].matrix).all()
        for frame, pose in poses.items()
    )
