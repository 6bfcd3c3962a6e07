"""The scene that a surgeon sees, in the MRML scene that is handed in."""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager

from slicer import (
    vtkMRMLApplicationLogic,
    vtkMRMLLinearTransformNode,
    vtkMRMLModelNode,
    vtkMRMLNode,
    vtkMRMLScene,
)
from vtkmodules.vtkCommonDataModel import vtkPolyData

from app.fixture import FixtureDecision, MarginState
from app.geometry import SurfaceMesh, Transform
from app.robot import Robot
from app.scene.errors import SceneError
from app.scene.frames.frame_graph import poses_in
from app.scene.frames.transform_tree import RAS, TransformTree
from app.scene.frames.watchdog import TransformHealth, TransformWatchdog
from app.scene.margin.margin_display import MarginDisplay
from app.scene.margin.shown_margin import shown_margin
from app.scene.nodes.adopted_nodes import PART, SURFACE, Earlier, mark
from app.scene.nodes.batch import Batch
from app.scene.nodes.models import add_model, ball, remove_displayed, smooth_surface
from app.scene.nodes.node_integrity import Upkeep
from app.scene.robot_model import RobotModel

TOOL_COLOR = (0.95, 0.80, 0.10)
_TUMOR_OPACITY = 0.4
_MARGIN_COLOR = (0.55, 0.62, 0.70)  # none of the colours of a state
_MARGIN_OPACITY = 0.15
_TIP_RADIUS_MM = 1.5


class MarginGuardScene:
    """Tumour, tool, robots and margin, as nodes of ``scene``; nothing global is used.

    ``reference`` is the frame of the sensor on the patient: everything hangs from its node
    ``ReferenceToRas``. Where the patient lies in RAS is not known to a tracker, so that node is
    for display only: the identity unless ``ras_from_reference`` says otherwise.

    With ``stale_after_ns`` the scene is a live one: `show` and `check` are told the present, and
    what is older than that is grey. None makes a picture of a moment, which does not age.
    ``logic`` is the application's, whose views then draw once an `update`.

    With ``go_on`` it takes over what an earlier one left in ``scene``, which was saved and is open
    again: frames, tumour and tool keep their nodes, with whatever hangs from them, and the rest is
    made anew. No other may be showing anything in ``scene`` then.
    """

    def __init__(
        self,
        scene: vtkMRMLScene,
        reference: str = "reference",
        ras_from_reference: Transform | None = None,
        *,
        stale_after_ns: int | None = None,
        logic: vtkMRMLApplicationLogic | None = None,
        go_on: bool = False,
    ) -> None:
        self.scene = scene
        self.reference = reference
        self.batch = Batch(scene, logic)
        self.watchdog = None if stale_after_ns is None else TransformWatchdog(stale_after_ns)
        earlier = Earlier.in_scene(scene) if go_on else Earlier()
        self._earlier_surfaces = earlier.surfaces
        self.tree = TransformTree(scene, self.batch, earlier.frames)
        self._upkeep = Upkeep()
        self.tree.set(ras_from_reference or Transform.identity(RAS, reference))
        self.tumor: vtkMRMLModelNode | None = None
        self.margin_surface: vtkMRMLModelNode | None = None
        self.tool: vtkMRMLModelNode | None = None
        self.margin: MarginDisplay | None = None
        self.robots: dict[str, RobotModel] = {}
        self._decision: FixtureDecision | None = None
        self._links_known: dict[str, bool] = {}
        self._shown_ns: int | None = None

    def update(self) -> AbstractContextManager[None]:
        """``with scene.update():`` around the changes of one frame.

        At its end, also after an error, every node that was changed tells its observers once and
        the views draw once (`Batch.on_end`). Updates may be nested: the outermost counts. Raises
        `SceneError` where somebody else has taken a node of ours out, as by closing the scene, or
        has changed the surface of one: `clear` takes out what is left then. What was hung elsewhere
        is hung back.
        """
        if not self.batch.is_open:
            self._upkeep.restore(self._nodes())
        return self.batch.changes()

    def set_poses(self, measured: Iterable[Transform], fixed: Iterable[Transform] = ()) -> None:
        """Move the frames: measured ones under the reference, fixed ones under their targets.

        ``measured`` edges may have any direction and pass through frames such as the tracker's;
        a frame that they do not connect with the reference stays where it is. A fixed edge whose
        target is in the scene neither before nor through an earlier edge raises `SceneError`.
        """
        self.place(poses_in(self.reference, measured).values(), fixed)

    def place(self, poses: Iterable[Transform], fixed: Iterable[Transform] = ()) -> None:
        """Move the frames: ``poses`` are ``root_from_frame``, ``fixed`` edges as in `set_poses`."""
        with self.update():
            for pose in poses:
                if pose.source != self.reference:
                    self.tree.set(pose)
            for edge in fixed:
                self.tree.set(edge)

    def add_tumor(self, mesh: SurfaceMesh) -> vtkMRMLModelNode:
        """Show the tumour, translucent, in the frame of ``mesh``; once a scene."""
        if self.tumor is not None:
            raise SceneError("the scene has a tumour already: one allowed")
        pose = self._pose_node(mesh.frame)
        with self._content():
            self.tumor = add_model(
                self.scene,
                "Tumor",
                smooth_surface(mesh),
                MarginState.UNKNOWN.color,  # until the first decision
                opacity=_TUMOR_OPACITY,
                parent=pose,
                node=self._earlier_surfaces.pop("Tumor", None),
            )
            mark(self.tumor, SURFACE)
            self.margin = MarginDisplay(self.scene, self.batch, self.tumor, pose, mesh.frame)
        return self.tumor

    def set_tumor(self, mesh: SurfaceMesh) -> vtkMRMLModelNode:
        """Show another tumour in the place of the one that is there, or the first one.

        Nothing that was said of the other holds any more: its marks and its margin surface go,
        and it is grey until the next decision. Its node stays, with whatever refers to it; a mesh
        in another frame than the first one's raises `SceneError`.
        """
        if self.tumor is None or self.margin is None:
            return self.add_tumor(mesh)
        self._upkeep.restore(self._nodes())
        if mesh.frame != self.margin.frame:
            raise SceneError(
                f"the new tumour is in frame {mesh.frame!r}: that of the present one, "
                f"{self.margin.frame!r}, wanted"
            )
        with self._content():
            self.remove_margin_surface()
            self.tumor.SetAndObservePolyData(smooth_surface(mesh))
            self._decision = None
            self.margin.breaches.clear()
            self._show_margin(self.margin, None)
        return self.tumor

    def add_margin_surface(self, mesh: SurfaceMesh) -> vtkMRMLModelNode:
        """Show ``mesh``, the surface at the stop margin (`app.fixture.margin_surface`), faintly.

        In its own frame, the tumour's. Another one takes the place of the one before.
        """
        pose = self._pose_node(mesh.frame)
        surface = smooth_surface(mesh)
        with self._content():
            if self.margin_surface is None:
                self.margin_surface = add_model(
                    self.scene,
                    "MarginSurface",
                    surface,
                    _MARGIN_COLOR,
                    opacity=_MARGIN_OPACITY,
                    parent=pose,
                )
            else:
                self.batch.hold(self.margin_surface)
                self.margin_surface.SetAndObservePolyData(surface)
                self.margin_surface.SetAndObserveTransformNodeID(pose.GetID())
        return self.margin_surface

    def remove_margin_surface(self) -> None:
        """Remove the surface at the stop margin, if there is one."""
        if self.margin_surface is not None:
            with self._content():
                remove_displayed(self.scene, self.margin_surface)
                self.margin_surface = None

    def add_tool(self, mesh: SurfaceMesh) -> vtkMRMLModelNode:
        """Show the tool in the frame of ``mesh``, its tip's."""
        return self._add_tool(smooth_surface(mesh), mesh.frame)

    def add_tip(self, frame: str) -> vtkMRMLModelNode:
        """Show a tool without a mesh as a small ball at its tip, the origin of ``frame``."""
        return self._add_tool(ball(_TIP_RADIUS_MM), frame)

    def add_robot(self, name: str, robot: Robot, base_frame: str) -> RobotModel:
        """Show ``robot`` with its root link at ``base_frame``; ``name`` tells several apart.

        In a live scene it is grey until somebody says where its links are: `show`, or whoever moves
        it by `RobotModel.set_links` and `RobotModel.set_known` from a source of its own.
        """
        if name in self.robots:
            raise SceneError(f"robot {name!r} is in the scene already: another name wanted")
        base = self._pose_node(base_frame)
        with self._content():
            model = RobotModel(self.scene, robot, base, base_frame, self.batch)
            model.set_known(self.watchdog is None)
            self.robots[name] = model
        return model

    def remove_robot(self, name: str) -> None:
        """Take the robot and all its nodes out of the scene."""
        robot = self._robot(name)
        with self.batch.content():
            robot.remove()
        del self.robots[name]
        self._links_known.pop(name, None)
        self._upkeep.note(self._parts())

    def show(
        self,
        decision: FixtureDecision,
        links: Mapping[str, Mapping[str, Transform]],
        now_ns: int | None = None,
    ) -> None:
        """Show one step: the decision, and ``root_from_link`` of every link of each robot.

        A robot with no links at all is where nobody knows: it turns grey, and so does one that
        ``links`` had once and has no more. In a live scene
        ``now_ns`` is the present on the clock of the decision's stamp, as in `check`; a picture of
        a moment takes none. Raises `SceneError` for the other way round, without a tumour, and for
        a constraint that is not in the tumour's frame: its plane would be drawn elsewhere.
        """
        if self.margin is None:
            raise SceneError("a decision cannot be shown: the scene has no tumour yet")
        constraint = decision.constraint
        if constraint is not None and constraint.frame != self.margin.frame:
            raise SceneError(
                f"the constraint is in frame {constraint.frame!r}: the tumour's, "
                f"{self.margin.frame!r}, wanted"
            )
        for name in links:
            self._robot(name)
        if (now_ns is None) is not (self.watchdog is None):
            raise SceneError(
                f"now_ns {now_ns} for a decision in a scene that "
                f"{'does not age: None' if self.watchdog is None else 'ages: the present'} wanted"
            )
        with self.update():
            self._decision, self._shown_ns = decision, now_ns
            self._show_margin(self.margin, now_ns)
            for name in self._links_known.keys() | links.keys():
                poses = links.get(name, {})
                self.robots[name].set_links(poses)
                self._links_known[name] = bool(poses)
            self._show_robots(known=True)

    def check(self, now_ns: int) -> tuple[TransformHealth, ...]:
        """Grey what has become too old by ``now_ns``, and tell how every watched transform is.

        What a user has moved by hand is put back, but for what is watched for edits.

        To be called by a timer of the shell, so that a source that has died is seen although
        nothing is shown any more: tumour and tool by the decision's stamp, robots by when they
        were shown last. The clock is that of the stamps. Raises `SceneError` for a scene that does
        not age.
        """
        if self.watchdog is None:
            raise SceneError("a scene without stale_after_ns does not age: nothing to check")
        with self.update():
            self.tree.restore()
            for robot in self.robots.values():
                robot.restore()
            if self.margin is not None:
                self._show_margin(self.margin, now_ns)
            self._show_robots(known=self.watchdog.is_fresh(self._shown_ns, now_ns))
        return self.watchdog.check(now_ns)

    def clear(self) -> None:
        """Take everything of this scene out of ``scene``; what others put there stays.

        It is over then: another `MarginGuardScene` shows what comes next.
        """
        with self.batch.content():
            for name in tuple(self.robots):
                self.remove_robot(name)
            if self.margin is not None:
                self.margin.remove()
            for node in (self.tumor, self.margin_surface, self.tool):
                if node is not None:
                    remove_displayed(self.scene, node)
            for node in self._earlier_surfaces.values():
                remove_displayed(self.scene, node)
            self._earlier_surfaces.clear()
            self.tumor = self.margin_surface = self.tool = self.margin = None
            self._decision = self._shown_ns = None
            self.tree.clear()
            self._upkeep.note(())

    @contextmanager
    def _content(self) -> Iterator[None]:
        """`update` in which nodes are added or removed."""
        self._upkeep.restore(self._nodes())
        with self.batch.content():
            yield
            for node in self._nodes():
                mark(node, PART)
            self._upkeep.note(self._parts())

    def _nodes(self) -> Iterator[vtkMRMLNode]:
        """All that is ours and should be in the scene."""
        yield from self.tree.nodes()
        yield from self._parts()

    def _parts(self) -> Iterator[vtkMRMLNode]:
        """What hangs from the tree, and from each other."""
        for node in (self.tumor, self.margin_surface, self.tool):
            if node is not None:
                yield node
        if self.margin is not None:
            yield from self.margin.nodes()
        for robot in self.robots.values():
            yield from (node for node in robot.transforms.values() if node is not robot.base)
            yield from robot.models.values()

    def _show_margin(self, margin: MarginDisplay, now_ns: int | None) -> None:
        margin.show(shown_margin(self._decision, self.watchdog, now_ns))
        if self.tool is not None:
            display = self.tool.GetDisplayNode()
            self.batch.hold(display)
            known = margin.state is not MarginState.UNKNOWN
            display.SetColor(*(TOOL_COLOR if known else MarginState.UNKNOWN.color))

    def _show_robots(self, *, known: bool) -> None:
        for name, links_known in self._links_known.items():
            self.robots[name].set_known(known and links_known)

    def _robot(self, name: str) -> RobotModel:
        if name not in self.robots:
            raise SceneError(f"no robot {name!r} in the scene: {sorted(self.robots)} are")
        return self.robots[name]

    def _add_tool(self, surface: vtkPolyData, frame: str) -> vtkMRMLModelNode:
        if self.tool is not None:
            raise SceneError("the scene has a tool already: one allowed")
        pose = self._pose_node(frame)
        color = TOOL_COLOR if self.watchdog is None else MarginState.UNKNOWN.color
        with self._content():
            node = self._earlier_surfaces.pop("Tool", None)
            self.tool = add_model(self.scene, "Tool", surface, color, parent=pose, node=node)
            mark(self.tool, SURFACE)
        return self.tool

    def _pose_node(self, frame: str) -> vtkMRMLLinearTransformNode:
        node = self.tree.node(frame)
        if node is None:
            raise SceneError(f"frame {frame!r} has no pose in the scene yet: set_poses first")
        return node
