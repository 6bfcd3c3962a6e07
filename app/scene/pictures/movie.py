"""A replay as a short animation (GIF): one scene and one view, moved from picture to picture."""

from collections.abc import Sequence
from io import BytesIO

import numpy as np
from PIL import Image

from app.fixture import MarginState
from app.scene.errors import SceneError
from app.scene.pictures.cameras import VIEW_ANGLE_DEG
from app.scene.pictures.framing import Camera, best_direction, fit
from app.scene.pictures.moment import Moment, MomentScene
from app.scene.pictures.picture import content_points, upright
from app.scene.pictures.pixels import Pixels, state_strip
from app.scene.pictures.view import offscreen_view

PICTURE_MS = 80
"""A GIF counts in hundredths of a second: this is 12.5 pictures a second."""
MOVIE_SIZE = (800, 450)

_BANNER_PIXELS = 40
_BACKGROUND = (0.93, 0.95, 0.97)
"""Of one colour: a gradient would make the file several times as large."""
_COLORS = 128
_SAME_LEVELS = 8
_SOME_MOMENTS, _SOME_POINTS = 16, 8
_SEEN_RADII = 3.6
"""How far around the tumour the picture reaches, in the tumour's radii."""


def movie_gif(
    subject: Moment,
    moments: Sequence[tuple[float, Moment]],
    size: tuple[int, int] = MOVIE_SIZE,
) -> bytes:
    """Draw ``moments`` of one case, each with its time in s, as an animated GIF.

    The camera stands still, near enough to fill the picture with what is around the tumour in
    ``subject``. A banner tells time, state and distance. Breaches are marked from where they happen
    on. ``size`` is width and height in pixels. Raises `OffscreenError` where nothing can be drawn
    without a screen.
    """
    shown = MomentScene(subject)
    margin = shown.scene.margin
    if margin is None:
        raise SceneError("a movie needs a tumour in the scene, there is none")
    margin.line.GetDisplayNode().SetPointLabelsVisibility(False)  # the banner has the distance
    width, height = size
    view_size = (width, height - _BANNER_PIXELS)
    with offscreen_view(shown.application, "MarginGuardMovie", view_size) as view:
        view.fill(_BACKGROUND)
        view.look(_camera(shown, [moment for _, moment in moments], view.aspect))

        def draw(time_s: float, moment: Moment) -> Pixels:
            shown.show(moment)
            text = f"{time_s:.1f} s  {margin.status.GetText()}"
            banner = state_strip(text, (width, _BANNER_PIXELS), margin.state)
            return np.concatenate([banner, view.pixels()])

        palette = _palette([draw(*moments[place]) for place in _one_a_state(moments)])
        margin.breaches.clear()
        pictures = [_indexed(draw(*moment), palette) for moment in moments]
    return _gif(pictures)


def _camera(shown: MomentScene, moments: Sequence[Moment], aspect: float) -> Camera:
    tumor, others = content_points(shown.scene)
    center = tumor.mean(axis=0)
    reach = _SEEN_RADII * float(np.linalg.norm(tumor - center, axis=1).max())
    near = others[np.linalg.norm(others - center, axis=1) < reach]
    # From where robot and tool hide the tumour least, all along.
    passing = [others[::_SOME_POINTS]]
    for moment in moments[:: max(1, len(moments) // _SOME_MOMENTS)]:
        shown.show(moment)
        passing.append(content_points(shown.scene)[1][::_SOME_POINTS])
    up = upright(shown.scene)
    towards = best_direction(tumor, np.concatenate(passing), up)
    points = np.concatenate([tumor, near])
    return fit(points, towards, up, angle_deg=VIEW_ANGLE_DEG, aspect=aspect)


def _one_a_state(moments: Sequence[tuple[float, Moment]]) -> list[int]:
    """The places of the first moment of each state: together they have all colours."""
    first: dict[object, int] = {}
    for place, (_, moment) in enumerate(moments):
        first.setdefault(moment.decision.state, place)
    return list(first.values())


def _palette(pictures: Sequence[Pixels]) -> Image.Image:
    """The states' colours and the background as they are, and what else ``pictures`` hold.

    Each of these counts once, however large it is in the pictures.
    """
    exact = np.round(255.0 * np.array([*(state.color for state in MarginState), _BACKGROUND]))
    colors = np.unique(np.concatenate(pictures).reshape(-1, 3) // _SAME_LEVELS, axis=0)
    everything = Image.fromarray((_SAME_LEVELS * colors + _SAME_LEVELS // 2)[np.newaxis])
    others = everything.quantize(_COLORS - len(exact), method=Image.Quantize.MEDIANCUT)
    palette = Image.new("P", (1, 1))
    palette.putpalette([*exact.astype(int).ravel().tolist(), *(others.getpalette() or ())])
    return palette


def _indexed(picture: Pixels, palette: Image.Image) -> Image.Image:
    # Without dithering, whose dots change from picture to picture and do not compress.
    return Image.fromarray(picture).quantize(palette=palette, dither=Image.Dither.NONE)


def _gif(pictures: Sequence[Image.Image]) -> bytes:
    file = BytesIO()
    first, *others = pictures
    first.save(
        file, "GIF", save_all=True, append_images=others, duration=PICTURE_MS, loop=0, disposal=1
    )
    return file.getvalue()
