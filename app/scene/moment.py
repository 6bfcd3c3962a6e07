"""One moment of a case as a picture: from plain values to PNG, in a scene of its own."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from slicer import vtkMRMLScene

from app.fixture import FixtureDecision
from app.geometry import SurfaceMesh, Transform
from app.robot import Robot
from app.scene.application import SceneApplication
from app.scene.picture import scene_png
from app.scene.scene import MarginGuardScene

_REFERENCE = "reference"


@dataclass(frozen=True, slots=True, eq=False)
class ShownRobot:
    """``robot`` with its root link at ``base_frame``; ``links``: ``root_from_link`` of each."""

    robot: Robot
    base_frame: str
    links: Mapping[str, Transform]


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """What is to be seen, and where it was.

    ``tumor`` in the frame "tumor" and ``tool`` in its tip's frame; None shows the tip alone.
    ``measured``: what the tracker knew, in any direction. ``fixed``: ``tool_from_tip``,
    ``frame_from_tumor`` and the registration, each from a measured frame.
    """

    decision: FixtureDecision
    tumor: SurfaceMesh
    tool: SurfaceMesh | None
    tip_frame: str
    measured: tuple[Transform, ...]
    fixed: tuple[Transform, ...]
    robot: ShownRobot | None = field(default=None)


def moment_png(moment: Moment) -> bytes:
    """Draw ``moment``; raises `OffscreenError` where nothing can be drawn without a screen.

    Everything is shown in the frame "reference", or, when the tracker did not know that, in the
    frame that the tumour moves with.
    """
    application = SceneApplication(vtkMRMLScene())
    scene = MarginGuardScene(application.scene, reference=_root(moment))
    scene.set_poses(moment.measured, moment.fixed)
    scene.add_tumor(moment.tumor)
    if moment.tool is None:
        scene.add_tip(moment.tip_frame)
    else:
        scene.add_tool(moment.tool)
    links = {}
    if moment.robot is not None:
        scene.add_robot(moment.robot.robot.name, moment.robot.robot, moment.robot.base_frame)
        links[moment.robot.robot.name] = moment.robot.links
    scene.show(moment.decision, links)
    return scene_png(application, scene, moment.decision)


def _root(moment: Moment) -> str:
    known = {name for edge in moment.measured for name in (edge.target, edge.source)}
    holder = next(edge.target for edge in moment.fixed if edge.source == moment.tumor.frame)
    return _REFERENCE if _REFERENCE in known else holder
