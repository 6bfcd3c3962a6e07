"""A replay as a short animation (GIF, MP4), drawn step by step in one scene and one view.

PyAV encodes the H.264 video of an MP4 file.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from fractions import Fraction
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from app.files.extras import check_installed
from app.fixture import MarginState
from app.geometry import InputError
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


_CODEC = "libx264"
_QUALITY = "18"
"""x264's constant rate factor: 0 is lossless, 51 the worst, 23 its default."""
_KEYFRAME_S = 1
"""A player seeks to this many seconds."""
_ITU601, _SMPTE170M, _LIMITED = 5, 6, 1
"""Codes of FFmpeg and H.264: the colours that players assume for a small picture."""


def video_mp4(pictures: Iterable[NDArray[np.uint8]], pictures_per_s: Fraction) -> bytes:
    """Encode ``pictures``, each (height, width, 3) RGB of one size, as an MP4 file.

    Colours have half of the resolution (4:2:0), which every player and browser decodes. The
    bytes may differ between two calls with the same pictures. Raises `InputError` without the extra
    ``video`` or its encoder, without a picture, for an odd width or height, and for pictures of
    different sizes.
    """
    check_installed("av")
    import av

    # A file, because the index is moved to its beginning at the end.
    with TemporaryDirectory() as folder:
        path = Path(folder) / "video.mp4"
        with av.open(path, "w", format="mp4", options={"movflags": "faststart"}) as container:
            _encode(container, pictures, pictures_per_s)
        return path.read_bytes()


def _encode(
    container: Any, pictures: Iterable[NDArray[np.uint8]], pictures_per_s: Fraction
) -> None:
    import av

    stream: Any = None
    for picture in pictures:
        height, width = picture.shape[:2]
        if stream is None:
            if width % 2 or height % 2:
                raise InputError(f"video: {width} x {height} pixels; expected even numbers")
            try:
                stream = container.add_stream(_CODEC, rate=pictures_per_s)
            except av.codec.codec.UnknownCodecError as error:
                raise InputError(
                    f"video: PyAV has no encoder {_CODEC}; expected the wheel of PyPI"
                ) from error
            _configure(stream, width, height, pictures_per_s)
        elif (width, height) != (stream.width, stream.height):
            raise InputError(
                f"video: a picture of {width} x {height} pixels after those of "
                f"{stream.width} x {stream.height}; expected one size"
            )
        frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
        encoded = frame.reformat(
            format="yuv420p",
            dst_colorspace=_ITU601,
            dst_color_range=_LIMITED,
            threads=1,  # as of the encoder
        )
        container.mux(stream.encode(encoded))
    if stream is None:
        raise InputError("video: no picture; expected at least one")
    container.mux(stream.encode())


def _configure(stream: Any, width: int, height: int, pictures_per_s: Fraction) -> None:
    stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
    stream.options = {"crf": _QUALITY, "preset": "medium"}
    context = stream.codec_context
    context.gop_size = round(_KEYFRAME_S * pictures_per_s)
    context.thread_count = 1  # the bytes depend on the number of threads
    context.colorspace, context.color_range = _ITU601, _LIMITED
    context.color_primaries = context.color_trc = _SMPTE170M
