"""The MRML nodes of tumour, tool, robots and margin."""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from types import MappingProxyType

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
from app.runtime import ShownItem, StructureContent, ToolContent
from app.scene.item_models import ItemModels, StructureModels
from app.scene.margin_display import MarginDisplay
from app.scene.models import add_model, ball, remove_displayed, smooth_surface
from app.scene.offscreen import SceneError
from app.scene.robot_model import RobotModel
from app.scene.scene_nodes import PART, SURFACE, AdoptedNodes, Batch, NodeIntegrity, mark
from app.scene.shown_margin import TransformHealth, TransformWatchdog, shown_margin
from app.scene.transform_tree import RAS, TransformTree
from app.session import named

TOOL_COLOR = (0.95, 0.80, 0.10)
_TUMOR_OPACITY = 0.4
_MARGIN_COLOR = (0.55, 0.62, 0.70)  # differs from the colour of each state
_MARGIN_OPACITY = 0.15
_TIP_RADIUS_MM = 1.5
NO_STATES: Mapping[str, MarginState] = MappingProxyType({})


class MarginGuardScene:
    """Nodes of one session in ``scene``. Uses no global state. Not thread-safe.

    `ScenePresenter` fills it from a session; a program with other sources may do so itself.

    ``reference`` is the root frame, that of the sensor on the patient. Its node is
    ``ReferenceToRas``. A tracker does not know where the patient is in RAS: ``ras_from_reference``
    is for display only, the identity by default.

    ``stale_after_ns`` makes a live scene: `show` and `check` take the present, and older data are
    shown grey. With None the scene does not age. ``logic`` is the application's: its views draw
    once per `update`.

    ``adopt_nodes``: reuse the frames, the tumour and the tool that an earlier object of this class
    left in ``scene`` before it was saved and loaded again, together with the nodes below them. All
    other nodes are created again. No other object may show anything in ``scene`` then.
    """

    def __init__(
        self,
        scene: vtkMRMLScene,
        reference: str = "reference",
        ras_from_reference: Transform | None = None,
        *,
        stale_after_ns: int | None = None,
        logic: vtkMRMLApplicationLogic | None = None,
        adopt_nodes: bool = False,
    ) -> None:
        self.scene = scene
        self.reference = reference
        self.batch = Batch(scene, logic)
        self.watchdog = None if stale_after_ns is None else TransformWatchdog(stale_after_ns)
        adopted = AdoptedNodes.in_scene(scene) if adopt_nodes else AdoptedNodes()
        self._adopted_surfaces = adopted.surfaces
        self.tree = TransformTree(scene, self.batch, adopted.frames)
        self._integrity = NodeIntegrity()
        self.tree.set(ras_from_reference or Transform.identity(RAS, reference))
        self.tumor: vtkMRMLModelNode | None = None
        self.margin_surface: vtkMRMLModelNode | None = None
        self.tool: vtkMRMLModelNode | None = None
        self.items = ItemModels(scene, self.batch, is_live=self.watchdog is not None)
        self.structures = StructureModels(scene, self.batch)
        self.margin: MarginDisplay | None = None
        self.robots: dict[str, RobotModel] = {}
        self._decision: FixtureDecision | None = None
        self._structure_states: Mapping[str, MarginState] = {}
        self._governing = ""
        self._links_known: dict[str, bool] = {}
        self._shown_ns: int | None = None

    def update(self) -> AbstractContextManager[None]:
        """Context of the changes of one frame: ``with scene.update(): ...``.

        At its end, also after an error, each changed node notifies its observers once and each view
        draws once. Updates may be nested; the outermost one counts. A node that a
        user has put under another parent is put back. Raises `SceneError` if a node was removed, as
        by closing the scene, or its surface was replaced: call `clear` then.
        """
        if not self.batch.is_open:
            self._integrity.restore(self._nodes())
        return self.batch.changes()

    def place(self, poses: Iterable[Transform], fixed: Iterable[Transform] = ()) -> None:
        """Move the frames: ``poses`` under the reference, ``fixed`` ones under their targets.

        ``poses`` are ``root_from_frame``, as `app.geometry.poses_in` makes them of measured edges;
        a frame without one stays where it is. Raises `SceneError` for a fixed edge whose target has
        no node, also not through an edge before it.
        """
        with self.update():
            for pose in poses:
                if pose.source != self.reference:
                    self.tree.set(pose)
            for edge in fixed:
                self.tree.set(edge)

    def add_tumor(self, mesh: SurfaceMesh) -> vtkMRMLModelNode:
        """Add the translucent tumour in the frame of ``mesh``; `SceneError` for a second one."""
        if self.tumor is not None:
            raise SceneError("the scene already has a tumour; expected 1")
        pose = self._pose_node(mesh.frame)
        with self._content():
            self.tumor = add_model(
                self.scene,
                "Tumor",
                smooth_surface(mesh),
                MarginState.UNKNOWN.color,  # until the first decision
                opacity=_TUMOR_OPACITY,
                parent=pose,
                node=self._adopted_surfaces.pop("Tumor", None),
            )
            mark(self.tumor, SURFACE)
            self.margin = MarginDisplay(self.scene, self.batch, self.tumor, pose, mesh.frame)
        return self.tumor

    def add_margin_surface(self, mesh: SurfaceMesh) -> vtkMRMLModelNode:
        """Add or replace the surface at the stop margin (`app.fixture.margin_surface`).

        ``mesh`` is in the tumour's frame. It is drawn nearly transparent.
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
        """Add the tool; the frame of ``mesh`` is the tip's."""
        return self._add_tool(smooth_surface(mesh), mesh.frame)

    def add_tip(self, frame: str) -> vtkMRMLModelNode:
        """Add a tool without a mesh: a small ball at its tip, the origin of ``frame``."""
        return self._add_tool(ball(_TIP_RADIUS_MM), frame)

    def show_item(self, item: ShownItem, *, known: bool) -> None:
        """Add ``item`` or draw it anew. ``known``: its pose may be used, whatever the margin is."""
        if not self.items.shows(item):
            pose = self._pose_node(item.tip_frame)
            with self._content():
                self.items.draw(item, pose)
        self.items.set_known(item, known)

    def add_structure(self, structure: StructureContent | ToolContent) -> None:
        """Add a structure or another tool; `SceneError` for a second one in its frame."""
        if structure.surface.frame in self.structures.nodes:
            raise SceneError(f"structure {structure.name!r} is already in the scene; expected 1")
        pose = self._pose_node(structure.surface.frame)
        with self._content():
            self.structures.add(structure, pose)

    def add_robot(self, name: str, robot: Robot, base_frame: str) -> RobotModel:
        """Add ``robot`` with its root link at ``base_frame``; each robot has a ``name`` of its own.

        In a live scene it is grey until its links are known: by `show`, or from another source by
        `RobotModel.set_links` and `RobotModel.set_known`.
        """
        if name in self.robots:
            raise SceneError(f"robot {name!r} is already in the scene; expected another name")
        base = self._pose_node(base_frame)
        with self._content():
            model = RobotModel(self.scene, robot, base, base_frame, self.batch)
            model.set_known(self.watchdog is None)
            self.robots[name] = model
        return model

    def remove_robot(self, name: str) -> None:
        """Remove the robot's nodes from the scene."""
        robot = self._robot(name)
        with self.batch.content():
            robot.remove()
        del self.robots[name]
        self._links_known.pop(name, None)
        self._integrity.record(self._parts())

    def show(
        self,
        decision: FixtureDecision,
        links: Mapping[str, Mapping[str, Transform]],
        now_ns: int | None = None,
        structures: Mapping[str, MarginState] = NO_STATES,
        governing: str = "",
    ) -> None:
        """Show the decision of one step, and each robot's links by their ``root_from_link``.

        ``structures`` are the states of further structures by name, ``governing`` is the one that
        the decision's distance belongs to, in words; empty for the tumour.

        A robot with an empty mapping is grey, and so is one that is missing in ``links`` but was in
        it before. ``now_ns``: the present of a live scene on the clock of the decision's stamp;
        None for a scene that does not age. Raises `SceneError` if ``now_ns`` does not fit the
        scene, without a tumour, and for a constraint in another frame than the tumour's.
        """
        if self.margin is None:
            raise SceneError("decision: the scene has no tumour; expected add_tumor before")
        constraint = decision.constraint
        if constraint is not None and constraint.frame != self.margin.frame:
            raise SceneError(
                f"constraint: frame is {constraint.frame!r}; expected {self.margin.frame!r}, the "
                "tumour's"
            )
        for name in links:
            self._robot(name)
        if (now_ns is None) is not (self.watchdog is None):
            expected = "None in a scene" if self.watchdog is None else "the present in a live scene"
            raise SceneError(f"decision: now_ns is {now_ns}; expected {expected}")
        with self.update():
            self._decision, self._shown_ns = decision, now_ns
            self._structure_states, self._governing = structures, governing
            self._show_margin(self.margin, now_ns)
            for name in self._links_known.keys() | links.keys():
                poses = links.get(name, {})
                self.robots[name].set_links(poses)
                self._links_known[name] = bool(poses)
            self._show_robots(known=True)

    def show_activation(self, label: str) -> None:
        """Show ``label`` in the text node of the energy device, which the first call adds.

        `check` replaces it by UNKNOWN when the data are too old. Display only.
        """
        if self.margin is None:
            return
        if self.margin.activation is None:
            with self._content():
                self.margin.add_activation()
        node = self.margin.activation
        with self.update():
            if node is not None:
                self.batch.hold(node)
                node.SetText(label)

    def check(self, now_ns: int) -> tuple[TransformHealth, ...]:
        """Show in grey what is too old at ``now_ns``; return the health of each watched transform.

        Call it from a timer, so that a source that has stopped is noticed. Tumour and tool age by
        the decision's stamp, robots by the last `show`, both on the clock of the stamps. Frames and
        links that a user has moved are put back, except those that are watched for edits. Raises
        `SceneError` for a scene that does not age.
        """
        if self.watchdog is None:
            raise SceneError("check: the scene has no stale_after_ns; expected a live scene")
        with self.update():
            self.tree.restore()
            for robot in self.robots.values():
                robot.restore()
            if self.margin is not None:
                self._show_margin(self.margin, now_ns)
            is_fresh = self.watchdog.is_fresh(self._shown_ns, now_ns)
            self._show_robots(known=is_fresh)
            if self.margin is not None and self.margin.activation is not None and not is_fresh:
                self.margin.activation.SetText(MarginState.UNKNOWN.name)
        return self.watchdog.check(now_ns)

    def clear(self) -> None:
        """Remove all nodes of this object, and no others; it cannot be used afterwards."""
        with self.batch.content():
            for name in tuple(self.robots):
                self.remove_robot(name)
            if self.margin is not None:
                self.margin.remove()
            for node in filter(None, (self.tumor, self.margin_surface, self.tool)):
                remove_displayed(self.scene, node)
            self.items.remove()
            self.structures.remove()
            for node in self._adopted_surfaces.values():
                remove_displayed(self.scene, node)
            self._adopted_surfaces.clear()
            self.tumor = self.margin_surface = self.tool = self.margin = None
            self._decision = self._shown_ns = None
            self.tree.clear()
            self._integrity.record(())

    @property
    def link_models(self) -> list[vtkMRMLModelNode]:
        """Models of the links of all robots."""
        return [model for robot in self.robots.values() for model in robot.models.values()]

    @contextmanager
    def _content(self) -> Iterator[None]:
        """Context of changes that add or remove nodes."""
        self._integrity.restore(self._nodes())
        with self.batch.content():
            yield
            for node in self._nodes():
                mark(node, PART)
            self._integrity.record(self._parts())

    def _nodes(self) -> Iterator[vtkMRMLNode]:
        """All nodes of this object."""
        yield from self.tree.nodes()
        yield from self._parts()

    def _parts(self) -> Iterator[vtkMRMLNode]:
        """The nodes that are not frames of the tree."""
        yield from filter(None, (self.tumor, self.margin_surface, self.tool))
        yield from self.items.nodes.values()
        yield from self.structures.nodes.values()
        if self.margin is not None:
            yield from self.margin.nodes()
        for robot in self.robots.values():
            yield from (node for node in robot.transforms.values() if node is not robot.base)
            yield from robot.models.values()

    def _show_margin(self, margin: MarginDisplay, now_ns: int | None) -> None:
        shown = shown_margin(self._decision, self.watchdog, now_ns)
        if shown.state is not MarginState.UNKNOWN:
            shown = replace(shown, text=named(shown.text, self._governing))
        margin.show(shown)
        known = margin.state is not MarginState.UNKNOWN
        is_fresh = self.watchdog is None or (
            now_ns is not None and self.watchdog.is_fresh(self._shown_ns, now_ns)
        )
        self.structures.show(self._structure_states if is_fresh else NO_STATES)
        for node, color, is_known in ((self.tool, TOOL_COLOR, True), *self.items.rods()):
            if node is not None:
                display = node.GetDisplayNode()
                self.batch.hold(display)
                display.SetColor(*(color if known and is_known else MarginState.UNKNOWN.color))

    def _show_robots(self, *, known: bool) -> None:
        for name, links_known in self._links_known.items():
            self.robots[name].set_known(known and links_known)

    def _robot(self, name: str) -> RobotModel:
        if name not in self.robots:
            known = ", ".join(sorted(self.robots)) or "none"
            raise SceneError(f"robot {name!r} is not in the scene; expected one of {known}")
        return self.robots[name]

    def _add_tool(self, surface: vtkPolyData, frame: str) -> vtkMRMLModelNode:
        if self.tool is not None:
            raise SceneError("the scene already has a tool; expected 1")
        pose = self._pose_node(frame)
        color = TOOL_COLOR if self.watchdog is None else MarginState.UNKNOWN.color
        with self._content():
            node = self._adopted_surfaces.pop("Tool", None)
            self.tool = add_model(self.scene, "Tool", surface, color, parent=pose, node=node)
            mark(self.tool, SURFACE)
        return self.tool

    def _pose_node(self, frame: str) -> vtkMRMLLinearTransformNode:
        node = self.tree.node(frame)
        if node is None:
            raise SceneError(
                f"frame {frame!r} has no pose in the scene; expected `place` to be called first"
            )
        return node
