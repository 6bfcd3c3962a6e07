"""The goal of the tool as a transform that Slicer's interaction handles move."""

from slicer import vtkMRMLLinearTransformNode
from vtkmodules.vtkCommonMath import vtkMatrix4x4

from app.geometry import NS_PER_S, MarginGuardError, Transform
from app.runtime import SessionContent
from app.scene import MarginGuardScene
from app.scene.convert import vtk_matrix
from app.session import StepResult
from app.workflow import GoalPose

NAME = "ToolGoal"


class GoalHandle:
    """A node below the robot's base while there is a goal, which follows the node."""

    def __init__(self, goal: GoalPose) -> None:
        self._goal = goal
        self._node: vtkMRMLLinearTransformNode | None = None
        self._pose: Transform | None = None
        self._written = vtkMatrix4x4()
        self._moved_ns = 0

    def update(self, scene: MarginGuardScene, content: SessionContent, step: StepResult) -> None:
        """Move the goal to where the node is. A node that the user has deleted ends it."""
        robot = content.robot
        base = None if robot is None else scene.tree.node(robot.base_frame)
        if self._node is not None and self._node.GetScene() is None:
            self._node = None
            self._goal.end()
        if base is None or self._goal.pose is None:
            self.remove()
            return
        if self._node is None:
            node = self._node = scene.scene.AddNewNodeByClass("vtkMRMLLinearTransformNode", NAME)
            node.SetSaveWithScene(False)
            node.CreateDefaultDisplayNodes()
            display = node.GetDisplayNode()
            display.SetEditorScalingEnabled(False)
            display.SetEditorVisibility(True)
        if self._node.GetTransformNodeID() != base.GetID():  # a new node, or the user has moved it
            self._node.SetAndObserveTransformNodeID(base.GetID())
            self._pose = None
        if self._goal.pose is self._pose:
            self._follow(step.frame.stamp.ns)
        if self._goal.pose is not self._pose:
            self._write()

    def remove(self) -> None:
        """Remove the node from the scene."""
        if self._node is not None and self._node.GetScene() is not None:
            self._node.GetScene().RemoveNode(self._node)
        self._node = self._pose = None

    def _write(self) -> None:
        assert self._node is not None
        assert self._goal.pose is not None
        self._pose = self._goal.pose
        self._written = vtk_matrix(self._pose)
        self._node.SetMatrixTransformToParent(self._written)

    def _follow(self, now_ns: int) -> None:
        """Move the goal if the node has moved; after a pause the structures are looked at again."""
        present = vtkMatrix4x4()
        self._node.GetMatrixTransformToParent(present)
        if present.GetData() == self._written.GetData():
            return
        assert self._pose is not None
        rows = [present.GetData()[4 * row : 4 * row + 4] for row in range(4)]
        try:
            moved = Transform.from_matrix(rows, target=self._pose.target, source=self._pose.source)
        except MarginGuardError:
            self._write()  # such as a scaled one
            return
        if abs(now_ns - self._moved_ns) > NS_PER_S:
            self._goal.hold()
        self._moved_ns = now_ns
        self._goal.place(moved.rotation, moved.translation_mm)
        # The node stays as it is: writing it would disturb the handles.
        self._pose, self._written = self._goal.pose, present
