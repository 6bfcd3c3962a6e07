from collections.abc import Callable
from io import BytesIO
from typing import Any

import numpy as np
import pytest
from PIL import Image

from app.cli.commands.replay import PICTURES_PER_S
from app.fixture import MarginState
from app.geometry import Transform
from app.scene import Moment, MomentScene, movie_gif
from app.scene.nodes.convert import world_matrix
from app.scene.pictures.movie import PICTURE_MS
from tests.scene.conftest import Decide

SIZE = (320, 200)
BANNER = 40
Make = Callable[..., Moment]


@pytest.fixture
def moment(moment_values: dict[str, Any], decision: Decide) -> Make:
    def make(state: MarginState, distance_mm: float | None = -2.0, **changes: object) -> Moment:
        judged = {"decision": decision(state, distance_mm)}
        return Moment(**{**moment_values, **judged, **changes})

    return make


# The tumour is translucent and lit: red, green and blue by how they differ.
SEEN_AS: dict[MarginState, Callable[..., np.ndarray]] = {
    MarginState.NEGATIVE: lambda r, g, b: (g > r + 60) & (g > b + 60),
    MarginState.WARNING: lambda r, g, b: (r > b + 60) & (g > b + 40) & (r > g + 20),
    MarginState.POSITIVE: lambda r, g, b: (r > g + 80) & (r > b + 60),
}


def amount_of(state: MarginState, picture: np.ndarray) -> int:
    return int(SEEN_AS[state](*np.moveaxis(picture.astype(int), -1, 0)).sum())


def moved(edges: tuple[Transform, ...], by_mm: float) -> tuple[Transform, ...]:
    shift = Transform("cautery", "cautery", np.eye(3), np.array([by_mm, 0.0, 0.0]))
    return (*edges[:2], edges[2] @ shift)


def pictures(gif: bytes) -> list[np.ndarray]:
    image = Image.open(BytesIO(gif))
    assert image.info["duration"] == PICTURE_MS
    assert image.info["loop"] == 0
    found = []
    for number in range(image.n_frames):
        image.seek(number)
        found.append(np.asarray(image.convert("RGB")))
    return found


@pytest.mark.usefixtures("can_draw")
def test_each_picture_has_the_colour_of_its_state_and_what_moves_moves(
    moment: Make, edges: tuple[Transform, ...]
) -> None:
    states = [
        MarginState.NEGATIVE,
        MarginState.WARNING,
        MarginState.POSITIVE,
        MarginState.UNKNOWN,
        MarginState.NEGATIVE,
    ]
    moments = [
        (0.5 * place, moment(state, measured=moved(edges, 6.0 * place)))
        for place, state in enumerate(states)
    ]
    found = pictures(movie_gif(moment(MarginState.POSITIVE), moments, SIZE))
    assert [picture.shape for picture in found] == [(SIZE[1], SIZE[0], 3)] * len(states)
    for picture, state in zip(found, states, strict=True):
        np.testing.assert_array_equal(picture[2, -2], np.round(255 * np.array(state.color)))
        amounts = {other: amount_of(other, picture[BANNER:]) for other in SEEN_AS}
        seen = amounts.pop(state, 300)  # of no colour: UNKNOWN
        assert seen >= 300 and seen > 3 * max(amounts.values()), (state, seen, amounts)
    # The first and the last picture differ by the tool alone.
    changed = np.abs(found[0][BANNER:].astype(int) - found[-1][BANNER:]).max(axis=2) > 60
    assert 20 < changed.sum() < 0.5 * changed.size


def test_the_command_counts_pictures_as_they_are_shown() -> None:
    assert PICTURES_PER_S * PICTURE_MS == 1000


@pytest.mark.usefixtures("can_draw")
def test_a_movie_is_the_same_at_every_run(moment: Make) -> None:
    moments = [(0.0, moment(MarginState.NEGATIVE)), (1.0, moment(MarginState.POSITIVE))]
    once = movie_gif(moments[1][1], moments, SIZE)
    assert (
        pictures(once)[0].tolist() == pictures(movie_gif(moments[1][1], moments, SIZE))[0].tolist()
    )


def test_a_moment_that_lost_the_reference_keeps_the_tool_where_it_is_to_the_tumour(
    moment: Make, edges: tuple[Transform, ...], fixed: tuple[Transform, ...]
) -> None:
    shown = MomentScene(moment(MarginState.POSITIVE))
    later = moved(edges, 25.0)[1:]  # the chest's sensor is not seen, the other two are
    shown.show(moment(MarginState.NEGATIVE, measured=later, robot=None))
    needle, cautery = (world_matrix(shown.scene.tree.node(name)) for name in ("needle", "cautery"))
    tracker_from_needle, tracker_from_cautery = later
    np.testing.assert_allclose(
        np.linalg.inv(needle) @ cautery,
        (tracker_from_needle.inverse() @ tracker_from_cautery).matrix,
        atol=1e-9,
    )
    # The tumour stays where it was last seen in the room; the robot is not known, and grey.
    np.testing.assert_allclose(needle, (edges[0].inverse() @ edges[1]).matrix, atol=1e-9)
    display = shown.scene.robots["arm"].models["fore_arm"].GetDisplayNode()
    assert not display.GetScalarVisibility()
