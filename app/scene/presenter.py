"""From a session's content and its steps to MRML nodes."""

from collections.abc import Iterable, Mapping, Sequence

from slicer import vtkMRMLApplicationLogic, vtkMRMLScene

from app.fixture import MarginState
from app.geometry import (
    FloatArray,
    FrameError,
    Freshness,
    SurfaceMesh,
    Transform,
    join_transform_name,
    poses_in,
)
from app.runtime import SessionContent, ShownItem, StructureContent, ToolContent
from app.scene.margin_display import MarkerStyle
from app.scene.scene import MarginGuardScene
from app.scene.shown_margin import TransformHealth
from app.session import REFERENCE, StepResult, governing_name

GRIP_OPACITY = 0.35
"""Opacity of the robot link that holds the tool: the tool is seen inside it."""


class ScenePresenter:
    """Shows steps of a session in ``mrml_scene``. Call it in the thread that owns the scene.

    The web page, the panel in Slicer, pictures, movies and saved scenes all use it.

    ``scene`` is None until a step places the tumour's tracked frame relative to another frame. The
    root frame is then the reference, or the tumour's tracked frame if the reference is not
    connected with it. A part is added at the first step that places it: the tumour and the tool (a
    ball at the tip without a mesh) when their frames are known, the robot when its base and its
    links are known. A frame that a later step does not place stays where it was.

    ``is_live``: data older than ``content.margins.stale_after_ns`` are shown as unknown, and `show`
    takes the present. ``logic`` is the application's, whose views draw once per step.
    ``adopt_nodes``: reuse the nodes that an earlier presenter left in a scene that was saved and
    loaded again.
    """

    def __init__(
        self,
        mrml_scene: vtkMRMLScene,
        content: SessionContent,
        *,
        is_live: bool = False,
        logic: vtkMRMLApplicationLogic | None = None,
        adopt_nodes: bool = False,
    ) -> None:
        self.content = content
        self.scene: MarginGuardScene | None = None
        self._mrml_scene = mrml_scene
        self._is_live = is_live
        self._logic = logic
        self._adopt_nodes = adopt_nodes
        self._margin_surface: SurfaceMesh | None = None
        self._measured: dict[tuple[str, str], Transform] = {}
        self._breach_count = 0
        self._deleted = 0
        self._marker_style = MarkerStyle()

    def set_content(self, content: SessionContent) -> None:
        """Use ``content`` from the next step on.

        Another tumour, structure, tool or robot: everything is removed from the scene, and the
        next step adds the new parts. Another registration, other margins or another tip of a
        display item change the nodes that exist. The margin surface is removed if the tumour or
        the stop margin changed.
        """
        if content is self.content:
            return
        before, self.content = self.content, content
        if content.tumor is not before.tumor:
            self._deleted = 0
        if content.tumor is not before.tumor or content.margins.stop_mm != before.margins.stop_mm:
            self.set_margin_surface(None)
        if _parts(before) != _parts(content):
            self.clear()
        elif self.scene is not None and self.scene.watchdog is not None:
            self.scene.watchdog.set_stale_after(content.margins.stale_after_ns)

    def set_margin_surface(self, mesh: SurfaceMesh | None) -> None:
        """Show ``mesh``, the surface at the stop margin around the tumour; None removes it.

        It is not part of the content because it takes about a second to compute.
        """
        if mesh is self._margin_surface:
            return
        self._margin_surface = mesh
        if self.scene is None or self.scene.tumor is None:
            return
        if mesh is None:
            self.scene.remove_margin_surface()
        else:
            self.scene.add_margin_surface(mesh)

    def show(
        self,
        step: StepResult,
        *,
        now_ns: int | None = None,
        measured: Iterable[Transform] | None = None,
        breach_points_mm: Sequence[FloatArray] | None = None,
    ) -> None:
        """Move the frames to where ``step`` has them and show its decision.

        ``now_ns``: the present on the clock of the step's stamps, for a live scene; else None.
        Steps that are not shown in their order need what the steps before ``step`` have left:
        ``measured``, the last good sample of each measured edge, and ``breach_points_mm``, where
        the tool was inside the tumour, each (3,) in the tumour's frame, in the order of the steps.
        None: what the steps shown so far have left.
        """
        self._measured |= {
            (sample.target, sample.source): sample.transform
            for sample in step.frame.poses
            if sample.transform is not None
        }
        edges = tuple(self._measured.values() if measured is None else measured)
        scene = self.scene or self._begin(step, edges)
        if scene is None:
            return
        with scene.update():
            if scene.watchdog is not None:
                for sample in step.frame.poses:
                    scene.watchdog.observe(sample)
            poses = self._poses(scene, step, edges)
            scene.place(poses.values(), self._placed_static_edges(poses))
            self._show_items(scene, step, poses)
            self._add_parts(scene, step)
            if breach_points_mm is not None:
                self._show_breaches(scene, breach_points_mm)
            if scene.tumor is not None:
                states = {each.name: each.decision.state for each in step.structures}
                states |= self._states_of_tools(step)
                links = dict.fromkeys(scene.robots, step.links)
                scene.show(step.decision, links, now_ns, states, governing_name(step))
                if step.frame.activation is not None:
                    scene.show_activation(step.frame.activation.label)

    def check(self, now_ns: int) -> tuple[TransformHealth, ...]:
        """Show data that are too old at ``now_ns`` as unknown; return each transform's health."""
        if self.scene is None:
            return ()
        health = self.scene.check(now_ns)
        for item in self.content.items:
            if item.is_pointer and not self._is_fresh(item, health):
                self.scene.items.set_known(item, False)
        return health

    def hide_pointers(self) -> None:
        """Hide the pointers until a step places them, as where the steps have ended."""
        for item in self.content.items:
            if item.is_pointer and self.scene is not None:
                self.scene.items.set_known(item, False)

    def health(self, now_ns: int) -> tuple[TransformHealth, ...]:
        """Freshness of each measured transform of a live scene at ``now_ns``."""
        if self.scene is None or self.scene.watchdog is None:
            return ()
        return self.scene.watchdog.check(now_ns)

    @property
    def marker_style(self) -> MarkerStyle:
        """Distance and size of the breach marks, for this scene and later ones."""
        return self._marker_style

    @marker_style.setter
    def marker_style(self, style: MarkerStyle) -> None:
        self._marker_style = style
        if self.scene is not None and self.scene.margin is not None:
            with self.scene.update():
                self.scene.margin.breaches.set_style(style)

    def delete_breach_marks(self) -> None:
        """Remove the marks of the breaches so far; later ones are marked again.

        Display only. With ``breach_points_mm`` they return when fewer points are shown, as for a
        replay that goes back.
        """
        self._deleted = self._breach_count
        if self.scene is not None and self.scene.margin is not None:
            with self.scene.update():
                self.scene.margin.breaches.clear()

    def restart(self) -> None:
        """Accept a next step from an earlier time, as after a seek. Breach marks are removed."""
        if self.scene is not None and self.scene.watchdog is not None:
            self.scene.watchdog.restart()
        self.clear_breaches()

    def clear_breaches(self) -> None:
        """Remove the breach marks."""
        self._breach_count = 0
        if self.scene is not None and self.scene.margin is not None:
            self.scene.margin.breaches.clear()

    def clear(self) -> None:
        """Remove all nodes of this presenter; the next step adds them again."""
        self._breach_count = 0
        if self.scene is not None:
            self.scene.clear()
        self.scene = None

    def _begin(self, step: StepResult, edges: Sequence[Transform]) -> MarginGuardScene | None:
        """The new scene, None while nothing places the frame that the tumour moves with."""
        holder = self.content.frame_from_tumor.target
        connected = poses_in(holder, edges)
        if len(connected) == 1 and step.tumor_from_tip is None:
            return None
        self.scene = MarginGuardScene(
            self._mrml_scene,
            REFERENCE if REFERENCE in connected else holder,
            stale_after_ns=self.content.margins.stale_after_ns if self._is_live else None,
            logic=self._logic,
            adopt_nodes=self._adopt_nodes,
        )
        if self.scene.watchdog is not None:
            for target, source in self._measured:
                self.scene.watchdog.expect(target, source)
        return self.scene

    def _poses(
        self, scene: MarginGuardScene, step: StepResult, edges: Sequence[Transform]
    ) -> dict[str, Transform]:
        """``root_from_frame`` of every measured frame.

        The tool is placed relative to the tumour as the step judged it: a tracker that reports
        tools at different times leaves the tool out of some frames, and the step then uses an
        earlier sample.
        """
        poses = poses_in(scene.reference, edges)
        frame_from_tumor = self.content.frame_from_tumor
        if step.tumor_from_tip is not None and frame_from_tumor.target in poses:
            tool_from_tip = self.content.tool_from_tip
            frame_from_tool = frame_from_tumor @ step.tumor_from_tip @ tool_from_tip.inverse()
            poses[tool_from_tip.target] = poses[frame_from_tumor.target] @ frame_from_tool
        return poses

    def _placed_static_edges(self, poses: dict[str, Transform]) -> list[Transform]:
        """The static edges that hang, directly or not, from a frame in ``poses``, parents first."""
        placed: list[Transform] = []
        known = set(poses)
        tips = (tool.tool_from_tip for tool in self.content.tools)
        for edge in (*self.content.static_edges, *tips):
            if edge.target in known:
                placed.append(edge)
                known.add(edge.source)
        return placed

    def _show_items(
        self, scene: MarginGuardScene, step: StepResult, poses: Mapping[str, Transform]
    ) -> None:
        """Place each display item once its frame is known, a pointer while it is tracked.

        A frame of the tip that is itself measured is left where it was measured.
        """
        for item in self.content.items:
            tip, known = item.frame_from_tip, self._is_tracked(item.frame, scene, step)
            is_placed = scene.tree.node(item.frame) is not None
            if tip is None or not is_placed or (item.is_pointer and not known):
                scene.items.set_known(item, False)
                continue
            if tip.source not in poses:
                scene.place((), (tip,))
            scene.show_item(item, known=known)

    def _is_fresh(self, item: ShownItem, health: Sequence[TransformHealth]) -> bool:
        """True if no measured edge of ``item`` is too old."""
        names = {
            join_transform_name(source, target)
            for target, source in self._measured
            if item.frame in (source, target)
        }
        return all(each.freshness is Freshness.VALID for each in health if each.name in names)

    def _is_tracked(self, frame: str, scene: MarginGuardScene, step: StepResult) -> bool:
        """True if the session may use the pose of ``frame``.

        Also for the tumour's frame: the state of the margin covers that one.
        """
        if frame == self.content.frame_from_tumor.target:
            return True
        try:
            step.edges.between(scene.reference, frame)
        except FrameError:
            return False
        return True

    def _states_of_tools(self, step: StepResult) -> dict[str, MarginState]:
        """The states of the other tools by the frames of their shapes."""
        states = {each.name: each.state for each in step.tools}
        tools = (each for each in self.content.tools if each.name in states)
        return {tool.surface.frame: states[tool.name] for tool in tools}

    def _add_parts(self, scene: MarginGuardScene, step: StepResult) -> None:
        content = self.content
        if scene.tumor is None and scene.tree.node(content.tumor.frame) is not None:
            scene.add_tumor(content.tumor)
            if scene.margin is not None:
                scene.margin.breaches.set_style(self._marker_style)
            if self._margin_surface is not None:
                scene.add_margin_surface(self._margin_surface)
        shapes: list[StructureContent | ToolContent] = [*content.structures, *content.tools]
        for structure in shapes:
            frame = structure.surface.frame
            is_placed = scene.tree.node(frame) is not None
            if is_placed and frame not in scene.structures.nodes:
                scene.add_structure(structure)
        if scene.tool is None and scene.tree.node(content.tip_frame) is not None:
            if content.tool is None:
                scene.add_tip(content.tip_frame)
            else:
                scene.add_tool(content.tool)
        robot = content.robot
        if (
            robot is not None
            and step.links
            and not scene.robots
            and scene.tree.node(robot.base_frame) is not None
        ):
            model = scene.add_robot(robot.robot.name, robot.robot, robot.base_frame)
            if robot.tool_link in model.models:
                model.models[robot.tool_link].GetDisplayNode().SetOpacity(GRIP_OPACITY)

    def _show_breaches(self, scene: MarginGuardScene, points_mm: Sequence[FloatArray]) -> None:
        if scene.margin is None:
            return
        if len(points_mm) < self._breach_count:
            self.clear_breaches()
        if len(points_mm) < self._deleted:
            self._deleted = 0
        for point in points_mm[max(self._breach_count, self._deleted) :]:
            scene.margin.breaches.add(point)
        self._breach_count = len(points_mm)


def _parts(content: SessionContent) -> list[object]:
    """The surfaces and the robot that ``content`` shows, without their poses."""
    robot = content.robot
    return [
        content.tumor,
        content.tool,
        content.tip_frame,
        None if robot is None else (robot.robot, robot.base_frame, robot.tool_link),
        *(
            (each.surface, each.role, content.static_edge(each.name).target)
            for each in content.structures
        ),
    ]
