"""``scene.png``: overview on the left, close-up of tumour and tool tip on the right."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from slicer import vtkMRMLDisplayableNode, vtkMRMLMarkupsLineNode, vtkMRMLScene

from app.geometry import FloatArray
from app.runtime import SessionContent
from app.scene.convert import world_matrix, world_points
from app.scene.offscreen import SceneError
from app.scene.pictures.camera_views import VIEW_ANGLE_DEG, best_direction, fit
from app.scene.pictures.offscreen_view import (
    OffscreenView,
    Pixels,
    SceneApplication,
    offscreen_view,
    png,
    state_strip,
)
from app.scene.presenter import ScenePresenter
from app.scene.scene import MarginGuardScene
from app.session import SHOWN_STATES, StepResult

SIZE = (1600, 964)
_BANNER_PIXELS = 64
_GAP_PIXELS = 4
_CLOSE_UP_RADII = 2.2
"""The close-up contains the parts of the tool within this many tumour radii."""


def scene_png(
    application: SceneApplication,
    scene: MarginGuardScene,
    size: tuple[int, int] = SIZE,
) -> bytes:
    """Draw ``scene`` as PNG: banner, overview, close-up.

    ``size`` is width and height in pixels. Raises `OffscreenError` where nothing can be drawn
    without a screen, and `SceneError` for a scene without a tumour.
    """
    margin = scene.margin
    if margin is None:
        raise SceneError("picture: the scene has no tumour; expected one")
    width, height = size
    half = ((width - _GAP_PIXELS) // 2, height - _BANNER_PIXELS)
    # One view for both: compiling shaders for a window takes longer than drawing.
    with offscreen_view(application, "MarginGuardPicture", half) as view:
        with _hidden(margin.line):  # its label would cover the small tumour
            overview = _overview(view, scene)
        with _hidden(*scene.link_models):  # the robot would hide the tool
            close_up = _close_up(view, scene, _along(margin.line))
    gap = np.full((half[1], width - 2 * half[0], 3), 255, dtype=np.uint8)
    banner = state_strip(
        margin.status.GetText(), (width, _BANNER_PIXELS), SHOWN_STATES[margin.state.name]
    )
    return png(np.concatenate([banner, np.concatenate([overview, gap, close_up], axis=1)]))


def _overview(view: OffscreenView, scene: MarginGuardScene) -> Pixels:
    tumor, others = content_points(scene)
    _look(view, scene, best_direction(tumor, others, up_direction(scene)), tumor, others)
    return view.pixels()


def _close_up(view: OffscreenView, scene: MarginGuardScene, along: FloatArray | None) -> Pixels:
    tumor = world_points(scene.tumor)
    tool = np.empty((0, 3)) if scene.tool is None else world_points(scene.tool)
    center = tumor.mean(axis=0)
    reach = _CLOSE_UP_RADII * float(np.linalg.norm(tumor - center, axis=1).max())
    near = tool[np.linalg.norm(tool - center, axis=1) < reach]
    towards = best_direction(tumor, tool, up_direction(scene), along=along)
    _look(view, scene, towards, tumor, near)
    return view.pixels()


def _look(
    view: OffscreenView,
    scene: MarginGuardScene,
    towards: FloatArray,
    subject: FloatArray,
    others: FloatArray,
) -> None:
    points = np.concatenate([subject, others])
    up = up_direction(scene)
    view.look(fit(points, towards, up, angle_deg=VIEW_ANGLE_DEG, aspect=view.aspect))


def content_points(scene: MarginGuardScene) -> tuple[FloatArray, FloatArray]:
    """World points (n, 3) of the tumour, and (m, 3) of the tool and the robots."""
    models = (*scene.link_models, scene.tool)
    others = [world_points(model) for model in models if model is not None]
    return world_points(scene.tumor), np.concatenate([np.empty((0, 3)), *others])


@contextmanager
def _hidden(*nodes: vtkMRMLDisplayableNode) -> Iterator[None]:
    displays = [node.GetDisplayNode() for node in nodes]
    visibilities = [display.GetVisibility() for display in displays]
    for display in displays:
        display.SetVisibility(False)
    try:
        yield
    finally:
        for display, was_visible in zip(displays, visibilities, strict=True):
            display.SetVisibility(was_visible)


def _along(line: vtkMRMLMarkupsLineNode) -> FloatArray | None:
    """Vector from the tumour's to the tool's closest point in RAS; None while it is unknown."""
    if not line.GetDisplayNode().GetVisibility() or line.GetNumberOfControlPoints() < 2:
        return None
    ends = np.zeros((2, 3))
    for index, end in enumerate(ends):
        line.GetNthControlPointPositionWorld(index, end)
    along = ends[1] - ends[0]
    return along if np.linalg.norm(along) > 0.0 else None


def up_direction(scene: MarginGuardScene) -> FloatArray:
    """Unit vector (3,) in RAS: +z of the first robot's base, or of the reference without one."""
    nodes = [robot.base for robot in scene.robots.values()]
    axis = world_matrix(nodes[0] if nodes else scene.tree.node(scene.reference))[:3, 2]
    return np.asarray(axis / np.linalg.norm(axis))


class StepScene:
    """A new scene that shows ``step``; ``presenter`` then shows other steps of the session.

    Raises `SceneError` if ``step`` does not place the tumour and the tool.
    """

    def __init__(self, content: SessionContent, step: StepResult) -> None:
        self.application = SceneApplication(vtkMRMLScene())
        self.presenter = ScenePresenter(self.application.scene, content)
        self.presenter.show(step)
        self.scene = _with_tumor_and_tool(self.presenter, step)


def step_png(content: SessionContent, step: StepResult, size: tuple[int, int] = SIZE) -> bytes:
    """Draw ``step`` in a new scene, as PNG of ``size`` (width, height) in pixels.

    Raises `OffscreenError` where nothing can be drawn without a screen, `SceneError` as
    `StepScene`.
    """
    shown = StepScene(content, step)
    return scene_png(shown.application, shown.scene, size)


def _with_tumor_and_tool(presenter: ScenePresenter, step: StepResult) -> MarginGuardScene:
    content, scene = presenter.content, presenter.scene
    if scene is not None and scene.tumor is not None and scene.tool is not None:
        return scene
    no_tumor = scene is None or scene.tumor is None
    frame = content.tumor.frame if no_tumor else content.tip_frame
    raise SceneError(
        f"step {step.index}: frame {frame!r} has no pose; expected a step that places the tumour "
        "and the tool"
    )
