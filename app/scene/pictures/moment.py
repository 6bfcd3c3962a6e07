"""A moment of a case: from plain values to a scene of its own, and to a picture of it."""

from collections.abc import Mapping
from dataclasses import dataclass

from slicer import vtkMRMLScene

from app.fixture import FixtureDecision
from app.geometry import SurfaceMesh, Transform
from app.robot import Robot
from app.scene.application import SceneApplication
from app.scene.errors import SceneError
from app.scene.frames.frame_graph import poses_in
from app.scene.pictures.picture import SIZE, scene_png
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
        holder = self.holder()
        return _REFERENCE if _REFERENCE in poses_in(holder, self.measured) else holder

    def holder(self) -> str:
        """The tracked frame that the tumour moves with."""
        return self._fixed_edge(self.tumor.frame).target

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


class MomentScene:
    """A scene of its own that shows ``moment``, and later other moments of the same case.

    A robot whose base is not known relative to the tumour at the first moment is left out.
    """

    def __init__(self, moment: Moment) -> None:
        self.application = SceneApplication(vtkMRMLScene())
        self.scene = MarginGuardScene(self.application.scene, reference=moment.root())
        self._holder = moment.holder()
        self._holder_pose: Transform | None = None
        self._move(moment)
        self.scene.add_tumor(moment.tumor)
        if moment.tool is None:
            self.scene.add_tip(moment.tip_frame)
        else:
            self.scene.add_tool(moment.tool)
        robot = moment.robot
        if robot is not None and self.scene.tree.node(robot.base_frame) is not None:
            model = self.scene.add_robot(robot.robot.name, robot.robot, robot.base_frame)
            if robot.tool_link in model.models:
                model.models[robot.tool_link].GetDisplayNode().SetOpacity(_GRIP_OPACITY)
        self._show(moment)

    def show(self, moment: Moment) -> None:
        """Show another moment. What is not known of it stays where it was, in grey."""
        with self.scene.update():
            self._move(moment)
            self._show(moment)

    def _move(self, moment: Moment) -> None:
        measured = moment.judged_edges()
        known = poses_in(self.scene.reference, measured)
        if self._holder not in known and self._holder_pose is not None:
            # Where the tumour is in the room is not known now, where the tool is to it may be.
            measured = (*measured, self._holder_pose)
            known = poses_in(self.scene.reference, measured)
        self._holder_pose = known.get(self._holder, self._holder_pose)
        self.scene.set_poses(measured, [edge for edge in moment.fixed if edge.target in known])

    def _show(self, moment: Moment) -> None:
        links = {} if moment.robot is None else {moment.robot.robot.name: moment.robot.links}
        self.scene.show(moment.decision, {name: links.get(name, {}) for name in self.scene.robots})


def moment_png(moment: Moment, size: tuple[int, int] = SIZE) -> bytes:
    """Draw ``moment`` in a scene of its own, as PNG of ``size`` (width, height).

    Raises `OffscreenError` where nothing can be drawn without a screen.
    """
    shown = MomentScene(moment)
    return scene_png(shown.application, shown.scene, size)
