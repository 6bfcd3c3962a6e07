"""The pushes of ``bench guided`` as an animated GIF: without the fixture, and beside it with it.

The poses are those of the physics, the line between the closest points and the plane those of the
fixture's decisions. A banner has the true distance, and the force of the hand.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO

import numpy as np
from PIL import Image
from slicer import vtkMRMLScene

from app.fixture import FixtureDecision, MarginState
from app.geometry import SurfaceMesh, Transform
from app.scene import MarginGuardScene, SceneApplication
from app.scene.nodes.convert import world_points
from app.scene.pictures.cameras import VIEW_ANGLE_DEG
from app.scene.pictures.framing import fit
from app.scene.pictures.pixels import Pixels, state_strip
from app.scene.pictures.view import OffscreenView, offscreen_view

PANEL = (440, 400)
"""Width and height of each half, in pixels."""
PICTURE_MS = 80
"""Duration of a picture. Pictures are `EVERY_MS` of simulated time apart: half speed."""
EVERY_MS = 40

_BANNER_PIXELS, _GAP_PIXELS, _COLORS = 44, 4, 96
_BACKGROUND = (0.93, 0.95, 0.97)
_TOWARDS = (0.35, -1.0, 0.25)
_REACH_MM = 42.0


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """One state of a push: true poses and distance, the force in N and the fixture's decision."""

    base_from_tumor: Transform
    base_from_tool: Transform
    distance_mm: float
    force_n: float
    decision: FixtureDecision


def push_gif(
    pushes: Sequence[tuple[str, Sequence[Moment]]],
    tumor: SurfaceMesh,
    tool: SurfaceMesh,
    stop_mm: float,
) -> bytes:
    """Draw ``pushes``, each with its title, beside each other; their last pictures stay.

    ``tumor`` and ``tool`` are in their own frames, of the same names. The first push is that
    without the fixture: its plane is not drawn. Raises `OffscreenError` where nothing can be drawn.
    """
    halves = [
        _panels(title, moments, tumor, tool, stop_mm, shows_plane=number > 0)
        for number, (title, moments) in enumerate(pushes)
    ]
    gap = np.full((PANEL[1], _GAP_PIXELS, 3), 255, dtype=np.uint8)
    pictures = []
    for number in range(max(len(half) for half in halves)):
        shown = [half[min(number, len(half) - 1)] for half in halves]
        pictures.append(Image.fromarray(np.concatenate([shown[0], gap, shown[1]], axis=1)))
    sheet = Image.fromarray(np.concatenate([np.asarray(p) for p in pictures[::8]]))
    palette = sheet.quantize(_COLORS, method=Image.Quantize.MEDIANCUT)
    first, *others = [p.quantize(palette=palette, dither=Image.Dither.NONE) for p in pictures]
    durations = [PICTURE_MS] * len(others) + [1500]
    file = BytesIO()
    first.save(
        file, "GIF", save_all=True, append_images=others, duration=durations, loop=0, optimize=True
    )
    return file.getvalue()


def _panels(
    title: str,
    moments: Sequence[Moment],
    tumor: SurfaceMesh,
    tool: SurfaceMesh,
    stop_mm: float,
    *,
    shows_plane: bool,
) -> list[Pixels]:
    application = SceneApplication(vtkMRMLScene())
    scene = MarginGuardScene(application.scene, "robot_base", logic=application.logic)
    scene.place([moments[0].base_from_tumor, moments[0].base_from_tool])
    scene.add_tumor(tumor)
    scene.add_tool(tool)
    size = (PANEL[0], PANEL[1] - _BANNER_PIXELS)
    with offscreen_view(application, "Push", size) as view:
        view.fill(_BACKGROUND)
        _look(view, scene)
        return [
            np.concatenate(
                [_banner(title, each, stop_mm), _picture(view, scene, each, shows_plane)]
            )
            for each in moments
        ]


def _picture(
    view: OffscreenView, scene: MarginGuardScene, moment: Moment, shows_plane: bool
) -> Pixels:
    with scene.update():
        scene.place([moment.base_from_tumor, moment.base_from_tool])
        scene.show(moment.decision, {})
    if scene.margin is not None:
        scene.margin.line.GetDisplayNode().SetPointLabelsVisibility(False)
        if not shows_plane:
            scene.margin.plane.node.GetDisplayNode().SetVisibility(False)
    return view.pixels()


def _banner(title: str, moment: Moment, stop_mm: float) -> Pixels:
    state = MarginState.NEGATIVE
    if moment.distance_mm < 5.0:
        state = MarginState.WARNING
    if moment.distance_mm < stop_mm:
        state = MarginState.POSITIVE
    text = f"{title}  {moment.distance_mm:+.1f} mm  hand {moment.force_n:.0f} N"
    return state_strip(text, (PANEL[0], _BANNER_PIXELS), state)


def _look(view: OffscreenView, scene: MarginGuardScene) -> None:
    tumor, tool = world_points(scene.tumor), world_points(scene.tool)
    near = tool[np.linalg.norm(tool - tumor.mean(axis=0), axis=1) < _REACH_MM + 30.0]
    towards = np.array(_TOWARDS) / np.linalg.norm(_TOWARDS)
    up = np.array([0.0, 0.0, 1.0])
    points = np.concatenate([tumor, near])
    view.look(fit(points, towards, up, angle_deg=VIEW_ANGLE_DEG, aspect=view.aspect))
