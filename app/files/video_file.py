"""Writes pictures as an MP4 file with H.264 video. PyAV encodes."""

from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.files.extras import check_installed
from app.geometry import InputError

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
            _check_even(width, height)
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


def _check_even(width: int, height: int) -> None:
    if width % 2 or height % 2:
        raise InputError(f"video: {width} x {height} pixels; expected even numbers")
