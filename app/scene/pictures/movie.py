"""A replay as a short animation (GIF, MP4), drawn step by step in one scene and one view."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from fractions import Fraction
from io import BytesIO

import numpy as np
from PIL import Image

from app.files.extras import check_installed
from app.files.video_file import video_mp4
from app.fixture import MarginState
from app.runtime import SessionContent
from app.scene.offscreen import SceneError
from app.scene.pictures.camera_views import VIEW_ANGLE_DEG, Camera, best_direction, fit
from app.scene.pictures.offscreen_view import Pixels, offscreen_view, state_strip
from app.scene.pictures.picture import StepScene, content_points, up_direction
from app.session import SHOWN_STATES, StepResult

PICTURE_MS = 80
"""A GIF counts in 1/100 s: 12.5 pictures per second."""
MOVIE_SIZE = (800, 450)

Keyframe = tuple[float, StepResult]
"""A step, and its time in s."""

_BANNER_PIXELS = 40
_BACKGROUND = (0.93, 0.95, 0.97)
"""One colour: a gradient makes the file several times as large."""
_COLORS = 128
_LEVELS_PER_BIN = 8
_CAMERA_KEYFRAMES, _POINT_STRIDE = 16, 8
_REACH_RADII = 3.6
"""Distance from the tumour that the picture shows, in tumour radii."""


def movie_gif(
    content: SessionContent,
    subject: StepResult,
    keyframes: Sequence[Keyframe],
    size: tuple[int, int] = MOVIE_SIZE,
) -> bytes:
    """Draw ``keyframes``, steps of one session with their times in s, as an animated GIF.

    The camera does not move. It fills the picture with the surroundings of the tumour in
    ``subject``. A banner shows time, state and distance. A breach is marked from the keyframe on in
    which it happens. ``size`` is width and height in pixels. Raises `OffscreenError` where nothing
    can be drawn without a screen, and `SceneError` if ``subject`` does not place tumour and tool.
    """
    with _drawing(content, subject, keyframes, size) as (shown, draw):
        palette = _palette([draw(*keyframe) for keyframe in _first_of_each_state(keyframes)])
        shown.presenter.clear_breaches()
        pictures = [_indexed(draw(*keyframe), palette) for keyframe in keyframes]
    return _gif(pictures)


def movie_mp4(
    content: SessionContent,
    subject: StepResult,
    keyframes: Sequence[Keyframe],
    size: tuple[int, int] = MOVIE_SIZE,
) -> bytes:
    """Draw the pictures of `movie_gif` as an MP4 file (H.264), in all colours.

    Raises `InputError` without the extra ``video`` or for an odd width or height, and what
    `movie_gif` raises.
    """
    check_installed("av")
    with _drawing(content, subject, keyframes, size) as (_, draw):
        pictures = (draw(*keyframe) for keyframe in keyframes)
        return video_mp4(pictures, Fraction(1000, PICTURE_MS))


@contextmanager
def _drawing(
    content: SessionContent,
    subject: StepResult,
    keyframes: Sequence[Keyframe],
    size: tuple[int, int],
) -> Iterator[tuple[StepScene, Callable[[float, StepResult], Pixels]]]:
    """The scene of a movie, and what draws one of its pictures."""
    shown = StepScene(content, subject)
    margin = shown.scene.margin
    if margin is None:
        raise SceneError("movie: the scene has no tumour; expected one")
    margin.line.GetDisplayNode().SetPointLabelsVisibility(False)  # the banner has the distance
    width, height = size
    view_size = (width, height - _BANNER_PIXELS)
    with offscreen_view(shown.application, "MarginGuardMovie", view_size) as view:
        view.fill(_BACKGROUND)
        view.look(_camera(shown, [step for _, step in keyframes], view.aspect))

        def draw(time_s: float, step: StepResult) -> Pixels:
            shown.presenter.show(step)
            text = f"{time_s:.1f} s  {margin.status.GetText()}"
            banner = state_strip(text, (width, _BANNER_PIXELS), SHOWN_STATES[margin.state.name])
            return np.concatenate([banner, view.pixels()])

        shown.presenter.clear_breaches()
        yield shown, draw


def _camera(shown: StepScene, steps: Sequence[StepResult], aspect: float) -> Camera:
    tumor, others = content_points(shown.scene)
    center = tumor.mean(axis=0)
    reach = _REACH_RADII * float(np.linalg.norm(tumor - center, axis=1).max())
    near = others[np.linalg.norm(others - center, axis=1) < reach]
    # From where robot and tool hide the tumour least during the whole movie.
    passing = [others[::_POINT_STRIDE]]
    for step in steps[:: max(1, len(steps) // _CAMERA_KEYFRAMES)]:
        shown.presenter.show(step)
        passing.append(content_points(shown.scene)[1][::_POINT_STRIDE])
    up = up_direction(shown.scene)
    towards = best_direction(tumor, np.concatenate(passing), up)
    points = np.concatenate([tumor, near])
    return fit(points, towards, up, angle_deg=VIEW_ANGLE_DEG, aspect=aspect)


def _first_of_each_state(keyframes: Sequence[Keyframe]) -> list[Keyframe]:
    """The first keyframe of each state: together they have all colours."""
    first: dict[MarginState, Keyframe] = {}
    for time_s, step in keyframes:
        first.setdefault(step.decision.state, (time_s, step))
    return list(first.values())


def _palette(pictures: Sequence[Pixels]) -> Image.Image:
    """The exact colours of the states and the background, and colours of ``pictures``.

    Each colour counts once, whatever area it has in the pictures.
    """
    exact = np.round(255.0 * np.array([*(state.color for state in MarginState), _BACKGROUND]))
    colors = np.unique(np.concatenate(pictures).reshape(-1, 3) // _LEVELS_PER_BIN, axis=0)
    everything = Image.fromarray((_LEVELS_PER_BIN * colors + _LEVELS_PER_BIN // 2)[np.newaxis])
    others = everything.quantize(_COLORS - len(exact), method=Image.Quantize.MEDIANCUT)
    palette = Image.new("P", (1, 1))
    palette.putpalette([*exact.astype(int).ravel().tolist(), *(others.getpalette() or ())])
    return palette


def _indexed(picture: Pixels, palette: Image.Image) -> Image.Image:
    # No dithering: its dots differ from picture to picture and do not compress.
    return Image.fromarray(picture).quantize(palette=palette, dither=Image.Dither.NONE)


def _gif(pictures: Sequence[Image.Image]) -> bytes:
    file = BytesIO()
    first, *others = pictures
    first.save(
        file, "GIF", save_all=True, append_images=others, duration=PICTURE_MS, loop=0, disposal=1
    )
    return file.getvalue()
