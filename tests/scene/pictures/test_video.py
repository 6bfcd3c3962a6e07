"""MP4 files, decoded by PyAV, and by OpenCV's own FFmpeg in tests/scene/pictures."""

from collections.abc import Iterator
from fractions import Fraction
from io import BytesIO

import numpy as np
import pytest

from app.files import extras
from app.geometry import InputError
from app.scene.pictures import movie
from app.scene.pictures.movie import video_mp4

RATE = Fraction(25, 2)
COLORS = [(230, 30, 30), (30, 160, 60), (128, 128, 128), (240, 170, 20)]
av = pytest.importorskip("av", reason="the extra video is not installed")


def pictures(count: int) -> Iterator[np.ndarray]:
    for number in range(count):
        picture = np.empty((90, 160, 3), np.uint8)
        picture[:] = COLORS[number % len(COLORS)]
        yield picture


def test_video_has_each_picture_at_its_time_in_its_colours():
    with av.open(BytesIO(video_mp4(pictures(30), RATE))) as container:
        (stream,) = container.streams
        assert stream.codec_context.name == "h264"
        assert stream.average_rate == RATE
        assert (stream.width, stream.height, stream.pix_fmt) == (160, 90, "yuv420p")
        assert float(stream.duration * stream.time_base) == pytest.approx(30 / 12.5)
        frames = list(container.decode(stream))
    assert [frame.time for frame in frames] == pytest.approx([n / 12.5 for n in range(30)])
    for number, frame in enumerate(frames):
        error = frame.to_ndarray(format="rgb24").astype(int) - COLORS[number % len(COLORS)]
        assert np.abs(error).max() <= 6


def test_index_is_before_the_pictures_so_that_a_browser_begins_at_once():
    content = video_mp4(pictures(5), RATE)
    assert 0 < content.index(b"moov") < content.index(b"mdat")


@pytest.mark.parametrize(
    ("shapes", "message"),
    [
        ([], "no picture; expected at least one"),
        ([(90, 161, 3)], "161 x 90 pixels; expected even numbers"),
        ([(90, 160, 3), (80, 160, 3)], "160 x 80 pixels after those of 160 x 90"),
    ],
)
def test_pictures_that_are_no_video_are_refused(shapes, message):
    with pytest.raises(InputError, match=message):
        video_mp4((np.zeros(shape, np.uint8) for shape in shapes), RATE)


def test_missing_encoder_is_one_line(monkeypatch):
    monkeypatch.setattr(movie, "_CODEC", "no_such_codec")
    with pytest.raises(InputError, match="PyAV has no encoder no_such_codec; expected"):
        video_mp4(pictures(1), RATE)


def test_missing_extra_is_one_line(monkeypatch):
    monkeypatch.setattr(extras, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"av is not installed: run `pip install .*video") as found:
        video_mp4(pictures(1), RATE)
    assert "\n" not in str(found.value)
