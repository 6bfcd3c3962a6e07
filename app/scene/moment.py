"""One moment of a case as a picture: from plain values to PNG, in a scene of its own."""

from collections.abc import Mapping
from dataclasses import dataclass

from slicer import vtkMRMLScene

from app.fixture import FixtureDecision
from app.geometry import SurfaceMesh, Transform
from app.robot import Robot
from app.scene.application import SceneApplication
from app.scene.errors import SceneError
from app.scene.frame_graph import poses_in
from app.scene.picture import SIZE, scene_png
from app.scene.scene import MarginGuardScene

_REFERENCE = "reference"
_GRIP_OPACITY = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class ShownRobot:
    """``robot`` with its root link at ``base_frame``; ``links``: ``root_from_link`` of each.

    ``tool_link`` holds the tool and is drawn translucent, so that the tool is seen in its grip.
    """

    robot: Robot
    base_frame: str
    links: Mapping[str, Transform]
    tool_link: str | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """What is to be seen, and where it was.

    ``tumor`` in the frame "tumor" and ``tool`` in its tip's frame; None shows the tip alone.
    ``measured``: what the tracker said at this moment, in any direction. ``fixed``:
    ``tool_from_tip``, ``frame_from_tumor`` and the registration. ``tumor_from_tip`` is the pose
    that ``decision`` judged; it need not be given when the measured edges connect both.
    """

    decision: FixtureDecision
    tumor: SurfaceMesh
    tool: SurfaceMesh | None
    tip_frame: str
    measured: tuple[Transform, ...]
    fixed: tuple[Transform, ...]
    robot: ShownRobot | None = None
    tumor_from_tip: Transform | None = None

    def root(self) -> str:
        """The frame to show it in: "reference", or the tumour's holder when that is not known."""
        holder = self._fixed_edge(self.tumor.frame).target
        return _REFERENCE if _REFERENCE in poses_in(holder, self.measured) else holder

    def judged_edges(self) -> tuple[Transform, ...]:
        """The measured edges, and the tool relative to the tumour as it was judged.

        Trackers that report tools at different times leave a tool out of some frames: the session
        then judged an earlier sample, which is not among ``measured``.
        """
        if self.tumor_from_tip is None:
            return self.measured
        tip_from_tool = self._fixed_edge(self.tip_frame).inverse()
        frame_from_tumor = self._fixed_edge(self.tumor.frame)
        return (*self.measured, frame_from_tumor @ self.tumor_from_tip @ tip_from_tool)

    def _fixed_edge(self, source: str) -> Transform:
        for edge in self.fixed:
            if edge.source == source:
                return edge
        raise SceneError(
            f"no fixed edge places {source!r}: "
            f"{', '.join(edge.source for edge in self.fixed) or 'none'} are placed"
        )


def moment_png(moment: Moment, size: tuple[int, int] = SIZE) -> bytes:
    """Draw ``moment`` in a scene of its own, as PNG of ``size`` (width, height).

    Raises `OffscreenError` where nothing can be drawn without a screen. A robot whose base is not
    known relative to the tumour is left out.
    """
    application = SceneApplication(vtkMRMLScene())
    scene = MarginGuardScene(application.scene, reference=moment.root())
    measured = moment.judged_edges()
    known = poses_in(moment.root(), measured)
    scene.set_poses(measured, [edge for edge in moment.fixed if edge.target in known])
    scene.add_tumor(moment.tumor)
    if moment.tool is None:
        scene.add_tip(moment.tip_frame)
    else:
        scene.add_tool(moment.tool)
    links = {}
    robot = moment.robot
    if robot is not None and scene.tree.node(robot.base_frame) is not None:
        model = scene.add_robot(robot.robot.name, robot.robot, robot.base_frame)
        if robot.tool_link in model.models:
            model.models[robot.tool_link].GetDisplayNode().SetOpacity(_GRIP_OPACITY)
        links[robot.robot.name] = robot.links
    scene.show(moment.decision, links)
    return scene_png(application, scene, moment.decision, size)
