"""The scene of a page: MRML nodes filled from steps, a view of them, and who is seen how."""

from enum import Enum

from slicer import vtkMRMLDisplayNode, vtkMRMLScene
from trame_slicer.views import ThreeDView
from trame_slicer.views.render_scheduler import NoScheduleRendering

from app.scene import MarginGuardScene, Moment, SceneApplication, use_offscreen_rendering
from app.scene.frames.frame_graph import poses_in
from app.viewer.errors import ViewerError
from app.viewer.steps.cast import Cast
from app.viewer.steps.view_state import ViewState

_INK = (0.92, 0.95, 0.98)
"""Of the closest-point line and its words, before a dark background."""
_GROUND = (0.055, 0.075, 0.095)
_GRIP_OPACITY = 0.35


class Part(Enum):
    """What can be shown, hidden and made translucent by itself; the value is its label."""

    TUMOR = "Tumour"
    MARGIN = "Margin surface"
    TOOL = "Tool"
    ROBOT = "Robot"


_ALONG = {Part.TOOL: 0.0, Part.ROBOT: 0.0}
"""How much of it there is in a view along the tool."""


class SceneView:
    """Shows one step after the other. Everything here belongs to one thread, the page's.

    Nothing stands on it before a step in which tool and tumour are both known: before that nobody
    knows where things are.
    """

    def __init__(self, cast: Cast) -> None:
        use_offscreen_rendering()
        self.cast = cast
        self.application = SceneApplication(vtkMRMLScene())
        self.scene: MarginGuardScene | None = None
        self.view = _view(self.application)
        self._strengths = dict.fromkeys(Part, 1.0)
        self._hidden: set[Part] = set()
        self._marked = 0
        self._along = dict.fromkeys(Part, 1.0)
        self._own: dict[Part, list[tuple[vtkMRMLDisplayNode, float]]] = {}

    @property
    def parts(self) -> tuple[Part, ...]:
        """Those that this cast has."""
        has = {Part.TUMOR, Part.TOOL}
        has |= {Part.MARGIN} if self.cast.margin is not None else set()
        has |= {Part.ROBOT} if self.cast.robot is not None else set()
        return tuple(part for part in Part if part in has)

    def visible(self, part: Part) -> bool:
        """Whether it is not hidden."""
        return part not in self._hidden

    def strength(self, part: Part) -> float:
        """How much of its own opacity it has, 0 to 1."""
        return self._strengths[part]

    def show(self, shown: ViewState) -> None:
        """Bring the scene to this step."""
        if shown.cast is not self.cast:
            self._recast(shown.cast)
        step = shown.step
        moment = Moment(
            decision=step.decision,
            tumor=self.cast.tumor,
            tool=self.cast.tool,
            tip_frame=self.cast.tip_frame,
            measured=shown.measured,
            fixed=self.cast.fixed,
            tumor_from_tip=step.tumor_from_tip,
        )
        scene = self.scene
        if scene is None:
            if step.tumor_from_tip is None:
                return
            logic = self.application.logic
            scene = MarginGuardScene(self.application.scene, moment.root(), logic=logic)
        with scene.update():
            measured = moment.judged_edges()
            known = poses_in(scene.reference, measured)
            scene.set_poses(measured, [edge for edge in self.cast.fixed if edge.target in known])
            if self.scene is None:
                self.scene = scene
                self._enter(scene)
            self._add_robot(scene)
            robot = self.cast.robot
            links = {robot.name: step.links} if robot and robot.name in scene.robots else {}
            self._mark(scene, shown)
            scene.show(step.decision, links)

    def _mark(self, scene: MarginGuardScene, shown: ViewState) -> None:
        """Exactly the breaches up to this step, also of steps that were left out or sought."""
        if scene.margin is None:
            return
        if shown.marked < self._marked:
            scene.margin.breaches.clear()
            self._marked = 0
        for point in shown.marks[self._marked : shown.marked]:
            scene.margin.breaches.add(point)
        self._marked = shown.marked

    def set_visible(self, part: Part, visible: bool) -> None:
        """Show or hide a part."""
        (self._hidden.discard if visible else self._hidden.add)(part)
        self._dress(part)

    def set_strength(self, part: Part, strength: float) -> None:
        """Make a part more or less translucent than it is by itself, 0 to 1."""
        if not 0.0 <= strength <= 1.0:
            raise ViewerError(f"opacity {strength} of {part.value.lower()}: 0 to 1 wanted")
        self._strengths[part] = strength
        self._dress(part)

    def look_along(self, along: bool) -> None:
        """Whether the view is along the tool: then what is behind the tip hides nothing."""
        self._along = {part: _ALONG.get(part, 1.0) if along else 1.0 for part in Part}
        for part in Part:
            self._dress(part)
        self._show_label(not along)

    def _recast(self, cast: Cast) -> None:
        """Another tumour or registration: nothing of the old one may stay."""
        self.cast = cast
        if self.scene is not None:
            self.scene.clear()
            self.scene = None
            self._marked = 0

    def _enter(self, scene: MarginGuardScene) -> None:
        scene.add_tumor(self.cast.tumor)
        if self.cast.margin is not None:
            scene.add_margin_surface(self.cast.margin)
        if self.cast.tool is None:
            scene.add_tip(self.cast.tip_frame)
        else:
            scene.add_tool(self.cast.tool)
        _ink(scene)
        for part in Part:
            self._own_of(scene, part)
        self._show_label(self._along[Part.TOOL] > 0.0)

    def _add_robot(self, scene: MarginGuardScene) -> None:
        """As soon as its base is known: the session may have begun without the reference."""
        robot = self.cast.robot
        if robot is None or scene.robots or scene.tree.node(self.cast.base_frame) is None:
            return
        scene.add_robot(robot.name, robot, self.cast.base_frame)
        self._own_of(scene, Part.ROBOT)

    def _own_of(self, scene: MarginGuardScene, part: Part) -> None:
        """Take note of a part's own opacity, and dress it."""
        self._own[part] = [(each, each.GetOpacity()) for each in self._displays(scene, part)]
        self._dress(part)

    def _show_label(self, shown: bool) -> None:
        """The distance beside the closest-point line, which would hide what the tool points at."""
        if self.scene is not None and self.scene.margin is not None:
            self.scene.margin.line.GetDisplayNode().SetPointLabelsVisibility(shown)

    def _displays(self, scene: MarginGuardScene, part: Part) -> list[vtkMRMLDisplayNode]:
        robots = scene.robots.values()
        nodes = {
            Part.TUMOR: [scene.tumor],
            Part.MARGIN: [scene.margin_surface],
            Part.TOOL: [scene.tool],
            Part.ROBOT: [model for robot in robots for model in robot.models.values()],
        }[part]
        for robot in robots:
            # The link that holds the tool would hide it.
            if part is Part.ROBOT and self.cast.tool_link in robot.models:
                robot.models[self.cast.tool_link].GetDisplayNode().SetOpacity(_GRIP_OPACITY)
        return [node.GetDisplayNode() for node in nodes if node is not None]

    def _dress(self, part: Part) -> None:
        if self.scene is None:
            return
        with self.scene.update():
            for display, own in self._own[part]:
                display.SetOpacity(own * self._strengths[part] * self._along[part])
                display.SetVisibility(self.visible(part) and self._along[part] > 0.0)


def _view(application: SceneApplication) -> ThreeDView:
    view = ThreeDView(
        application.scene,
        application.logic,
        "MarginGuard",
        scheduled_render_strategy=NoScheduleRendering(),
    )
    node = view.get_view_node()
    node.SetBoxVisible(False)
    node.SetAxisLabelsVisible(False)
    node.SetBackgroundColor(*_GROUND)
    node.SetBackgroundColor2(*_GROUND)
    # A gradient costs a sixth of a picture where the processor draws.
    view.renderer().SetGradientBackground(False)
    view.render_window().SetMultiSamples(0)
    return view


def _ink(scene: MarginGuardScene) -> None:
    if scene.margin is None:
        return
    display = scene.margin.line.GetDisplayNode()
    display.SetSelectedColor(*_INK)
    display.SetColor(*_INK)
    text = display.GetTextProperty()
    text.SetBackgroundColor(*_GROUND)
