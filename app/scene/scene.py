"""The scene that a surgeon sees, in the MRML scene that is handed in."""

from collections.abc import Iterable, Mapping

from slicer import vtkMRMLLinearTransformNode, vtkMRMLModelNode, vtkMRMLScene
from vtkmodules.vtkCommonDataModel import vtkPolyData
from vtkmodules.vtkFiltersSources import vtkSphereSource

from app.fixture import FixtureDecision
from app.geometry import SurfaceMesh, Transform
from app.robot import Robot
from app.scene.errors import SceneError
from app.scene.frame_graph import poses_in
from app.scene.margin_display import MarginDisplay
from app.scene.models import add_model, remove_displayed, smooth_surface
from app.scene.robot_model import RobotModel
from app.scene.transform_tree import RAS, TransformTree

TOOL_COLOR = (0.95, 0.80, 0.10)
_TUMOR_COLOR = (0.5, 0.5, 0.5)  # unknown until the first decision
_TUMOR_OPACITY = 0.4
_TIP_RADIUS_MM = 1.5


class MarginGuardScene:
    """Tumour, tool, robots and margin, as nodes of ``scene``; nothing global is used.

    ``reference`` is the frame of the sensor on the patient: everything hangs from its node
    ``ReferenceToRas``. Where the patient lies in RAS is not known to a tracker, so that node is
    for display only: the identity unless ``ras_from_reference`` says otherwise.
    """

    def __init__(
        self,
        scene: vtkMRMLScene,
        reference: str = "reference",
        ras_from_reference: Transform | None = None,
    ) -> None:
        self.scene = scene
        self.reference = reference
        self.tree = TransformTree(scene)
        self.tree.set(ras_from_reference or Transform.identity(RAS, reference))
        self.tumor: vtkMRMLModelNode | None = None
        self.tool: vtkMRMLModelNode | None = None
        self.margin: MarginDisplay | None = None
        self.robots: dict[str, RobotModel] = {}

    def set_poses(self, measured: Iterable[Transform], fixed: Iterable[Transform] = ()) -> None:
        """Move the frames: measured ones under the reference, fixed ones under their targets.

        ``measured`` edges may have any direction and pass through frames such as the tracker's;
        a frame that they do not connect with the reference stays where it is. A fixed edge whose
        target is in the scene neither before nor through an earlier edge raises `SceneError`.
        """
        for frame, pose in poses_in(self.reference, measured).items():
            if frame != self.reference:
                self.tree.set(pose)
        for edge in fixed:
            self.tree.set(edge)

    def add_tumor(self, mesh: SurfaceMesh) -> vtkMRMLModelNode:
        """Show the tumour, translucent, in the frame of ``mesh``; once a scene."""
        if self.tumor is not None:
            raise SceneError("the scene has a tumour already: one allowed")
        pose = self._pose_node(mesh.frame)
        self.tumor = add_model(
            self.scene,
            "Tumor",
            smooth_surface(mesh),
            _TUMOR_COLOR,
            opacity=_TUMOR_OPACITY,
            parent=pose,
        )
        self.margin = MarginDisplay(self.scene, self.tumor, pose)
        return self.tumor

    def add_tool(self, mesh: SurfaceMesh) -> vtkMRMLModelNode:
        """Show the tool in the frame of ``mesh``, its tip's."""
        return self._add_tool(smooth_surface(mesh), mesh.frame)

    def add_tip(self, frame: str) -> vtkMRMLModelNode:
        """Show a tool without a mesh as a small ball at its tip, the origin of ``frame``."""
        ball = vtkSphereSource()
        ball.SetRadius(_TIP_RADIUS_MM)
        ball.SetThetaResolution(32)
        ball.SetPhiResolution(32)
        ball.Update()
        return self._add_tool(ball.GetOutput(), frame)

    def add_robot(self, name: str, robot: Robot, base_frame: str) -> RobotModel:
        """Show ``robot`` with its root link at ``base_frame``; ``name`` tells several apart."""
        if name in self.robots:
            raise SceneError(f"robot {name!r} is in the scene already: another name wanted")
        self.robots[name] = RobotModel(self.scene, robot, self._pose_node(base_frame), base_frame)
        return self.robots[name]

    def remove_robot(self, name: str) -> None:
        """Take the robot and all its nodes out of the scene."""
        if name not in self.robots:
            raise SceneError(f"no robot {name!r} in the scene: {sorted(self.robots)} are")
        self.robots.pop(name).remove()

    def show(self, decision: FixtureDecision, links: Mapping[str, Mapping[str, Transform]]) -> None:
        """Show one step: the decision, and ``root_from_link`` of every link of each robot."""
        if self.margin is None:
            raise SceneError("a decision cannot be shown: the scene has no tumour yet")
        self.margin.show(decision)
        for name, poses in links.items():
            self.robots[name].set_links(poses)

    def clear(self) -> None:
        """Take everything of this scene out of ``scene``; what others put there stays."""
        for name in tuple(self.robots):
            self.remove_robot(name)
        if self.margin is not None:
            self.margin.remove()
        for node in (self.tumor, self.tool):
            if node is not None:
                remove_displayed(self.scene, node)
        self.tumor = self.tool = self.margin = None
        self.tree.clear()

    def _add_tool(self, surface: vtkPolyData, frame: str) -> vtkMRMLModelNode:
        if self.tool is not None:
            raise SceneError("the scene has a tool already: one allowed")
        self.tool = add_model(
            self.scene, "Tool", surface, TOOL_COLOR, parent=self._pose_node(frame)
        )
        return self.tool

    def _pose_node(self, frame: str) -> vtkMRMLLinearTransformNode:
        node = self.tree.node(frame)
        if node is None:
            raise SceneError(f"frame {frame!r} has no pose in the scene yet: set_poses first")
        return node
