from collections.abc import Callable
from io import BytesIO

import cv2
import numpy as np
import pytest
from PIL import Image

from app.cli.scene_log import PICTURES_PER_S
from app.fixture import MarginState
from app.geometry import InputError, Transform
from app.scene import StepScene, movie_gif, movie_mp4
from app.scene.convert import world_matrix
from app.scene.pictures.movie import PICTURE_MS

pytestmark = pytest.mark.slow

SIZE = (320, 200)
BANNER = 40

# The tumour is translucent and lit: compare channels with each other.
SEEN_AS: dict[MarginState, Callable[..., np.ndarray]] = {
    MarginState.NEGATIVE: lambda r, g, b: (g > r + 60) & (g > b + 60),
    MarginState.WARNING: lambda r, g, b: (r > b + 60) & (g > b + 40) & (r > g + 20),
    MarginState.POSITIVE: lambda r, g, b: (r > g + 80) & (r > b + 60),
}


def amount_of(state, picture):
    return int(SEEN_AS[state](*np.moveaxis(picture.astype(int), -1, 0)).sum())


def moved(edges, by_mm):
    shift = Transform("cautery", "cautery", np.eye(3), np.array([by_mm, 0.0, 0.0]))
    return (*edges[:2], edges[2] @ shift)


def pictures(gif):
    image = Image.open(BytesIO(gif))
    assert image.info["duration"] == PICTURE_MS
    assert image.info["loop"] == 0
    found = []
    for number in range(image.n_frames):
        image.seek(number)
        found.append(np.asarray(image.convert("RGB")))
    return found


@pytest.mark.usefixtures("can_draw")
def test_each_picture_has_the_colour_of_its_state_and_what_moves_moves(content, make_step, edges):
    states = [
        MarginState.NEGATIVE,
        MarginState.WARNING,
        MarginState.POSITIVE,
        MarginState.UNKNOWN,
        MarginState.NEGATIVE,
    ]
    keyframes = [
        (0.5 * place, make_step(state, measured=moved(edges, 6.0 * place)))
        for place, state in enumerate(states)
    ]
    found = pictures(movie_gif(content, make_step(MarginState.POSITIVE), keyframes, SIZE))
    assert [picture.shape for picture in found] == [(SIZE[1], SIZE[0], 3)] * len(states)
    for picture, state in zip(found, states, strict=True):
        np.testing.assert_array_equal(picture[2, -2], np.round(255 * np.array(state.color)))
        amounts = {other: amount_of(other, picture[BANNER:]) for other in SEEN_AS}
        seen = amounts.pop(state, 300)  # of no colour: UNKNOWN
        assert seen >= 300 and seen > 3 * max(amounts.values()), (state, seen, amounts)
    # The first and the last picture differ by the tool alone.
    changed = np.abs(found[0][BANNER:].astype(int) - found[-1][BANNER:]).max(axis=2) > 60
    assert 20 < changed.sum() < 0.5 * changed.size


def test_command_and_movie_have_the_same_frame_rate():
    assert PICTURES_PER_S * PICTURE_MS == 1000


def test_step_without_the_reference_keeps_the_tool_where_it_is_to_the_tumour(
    content, make_step, edges
):
    shown = StepScene(content, make_step(MarginState.POSITIVE))
    later = moved(edges, 25.0)[1:]  # the chest's sensor is not seen, the other two are
    shown.presenter.show(make_step(MarginState.NEGATIVE, measured=later, links={}))
    needle, cautery = (world_matrix(shown.scene.tree.node(name)) for name in ("needle", "cautery"))
    tracker_from_needle, tracker_from_cautery = later
    np.testing.assert_allclose(
        np.linalg.inv(needle) @ cautery,
        (tracker_from_needle.inverse() @ tracker_from_cautery).matrix,
        atol=1e-9,
    )
    # The tumour stays where it was in the reference; the robot is unknown, and grey.
    np.testing.assert_allclose(needle, (edges[0].inverse() @ edges[1]).matrix, atol=1e-9)
    display = shown.scene.robots["arm"].models["fore_arm"].GetDisplayNode()
    assert not display.GetScalarVisibility()


def decoded(path):
    """Pictures (h, w, 3) RGB of a video and how many a second, by OpenCV's own FFmpeg."""
    video = cv2.VideoCapture(str(path))
    found = []
    while True:
        is_read, picture = video.read()
        if not is_read:
            break
        found.append(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB))
    rate = video.get(cv2.CAP_PROP_FPS)
    video.release()
    return found, rate


@pytest.mark.usefixtures("can_draw")
def test_video_has_the_pictures_of_the_animation(content, make_step, edges, tmp_path):
    states = [MarginState.NEGATIVE, MarginState.POSITIVE, MarginState.UNKNOWN]
    keyframes = [
        (0.5 * place, make_step(states[place % 3], measured=moved(edges, 2.0 * place)))
        for place in range(6)
    ]
    subject = make_step(MarginState.POSITIVE)
    video = movie_mp4(content, subject, keyframes, SIZE)
    (tmp_path / "movie.mp4").write_bytes(video)
    found, rate = decoded(tmp_path / "movie.mp4")
    assert rate == pytest.approx(1000 / PICTURE_MS)
    gif = pictures(movie_gif(content, subject, keyframes, SIZE))
    assert [each.shape for each in found] == [each.shape for each in gif]
    for seen, expected, (_, step) in zip(found, gif, keyframes, strict=True):
        error = np.abs(seen.astype(int) - expected)
        assert np.median(error) <= 3 and error.mean() < 6.0
        banner = np.round(255 * np.array(step.decision.state.color))
        assert np.abs(seen[2:6, -6:-2].astype(int) - banner).max() <= 8


@pytest.mark.usefixtures("can_draw")
def test_video_of_an_odd_size_is_refused(content, make_step):
    steps = [(0.0, make_step(MarginState.NEGATIVE))]
    with pytest.raises(InputError, match="321 x 200 pixels; expected even numbers"):
        movie_mp4(content, steps[0][1], steps, (321, 200))
