from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest
from matplotlib.image import imread
from slicer import vtkMRMLScene

from app.fixture import MarginState
from app.geometry import Transform
from app.scene import MarginGuardScene, SceneApplication, SceneError, scene_png, step_png
from app.scene.pictures.offscreen_view import png, state_strip
from app.session import SHOWN_STATES
from tests.scene.scene_content import set_poses

SIZE = (640, 450)  # small: a machine without a graphics card draws these
pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("can_draw")]


@pytest.fixture(scope="module")
def draw(content, arm, make_step):
    """Draws the case in a state; returns the picture without the banner, values from 0 to 1."""

    bent = arm.forward_kinematics({"shoulder": 0.9, "elbow": 0.6})

    def build(state=MarginState.POSITIVE, content=content, links=bent, **changes):
        step = make_step(state, -2.0, links=links, **changes)
        picture = imread(BytesIO(step_png(content, step, SIZE)))
        assert picture.shape[:2] == SIZE[::-1]
        return picture[64:, :, :3]

    return build


def amount(picture, reddish):
    return int(reddish(*np.moveaxis(picture, -1, 0)).sum())


def is_red(r, g, b):
    return (r > 0.4) & (r > 1.6 * g) & (r > 1.3 * b)


def is_green(r, g, b):
    return (g > 0.4) & (g > 1.3 * r) & (g > 1.3 * b)


def is_blue(r, g, b):
    return (b > 0.3) & (b > 1.6 * r) & (b > 1.6 * g)


def is_yellow(r, g, b):
    return (r > 0.4) & (g > 0.35) & (b < 0.3) & (r < 1.5 * g)


def is_yellowish(r, g, b):
    return (r > b + 0.1) & (g > b + 0.05)


@pytest.fixture(scope="module")
def picture(draw):
    """The picture of a breach."""
    return draw()


def test_tumor_shows_its_state_in_both_views(draw, picture):
    red, green = picture, draw(MarginState.NEGATIVE)
    half = SIZE[0] // 2
    for view in (np.s_[:, :half], np.s_[:, half:]):
        assert amount(red[view], is_red) > 100
        assert amount(red[view], is_green) < 10
        assert amount(green[view], is_green) > 100
        assert amount(green[view], is_red) < 10
    # The close-up is one: the tumour fills much of it.
    assert amount(red[:, half:], is_red) > 10 * amount(red[:, :half], is_red)


def test_tool_and_robot_are_visible_in_the_overview(picture):
    overview = picture[:, : SIZE[0] // 2]
    assert amount(overview, is_yellow) > 40
    assert amount(overview, is_blue) > 400


def test_tool_is_visible_through_the_holding_link_and_alone_in_the_close_up(draw, arm, content):
    # The forearm reaches to where the tool is: the tool of 60 mm is put wholly inside of it.
    links = arm.forward_kinematics({})
    base_from_tip = links["fore_arm"].renamed(target="robot_base") @ Transform(
        "fore_arm", "cautery_tip", np.eye(3), np.array([0.0, 0.0, 64.0])
    )
    base = Transform.identity("reference", "robot_base")
    measured = (
        (base @ base_from_tip).renamed(source="cautery"),
        (base @ base_from_tip).renamed(source="needle"),
    )
    static_edges = (
        Transform.identity("cautery", "cautery_tip"),
        Transform("needle", "tumor", np.eye(3), np.array([0.0, 0.0, 14.0])),
        base,
    )
    half = SIZE[0] // 2
    for tool_link, lowest, highest in (("upper", 0, 20), ("fore_arm", 40, 10**6)):
        held = replace(
            content, static_edges=static_edges, robot=replace(content.robot, tool_link=tool_link)
        )
        picture = draw(content=held, links=links, measured=measured)
        assert lowest <= amount(picture[:, :half], is_yellowish) <= highest
        assert amount(picture[:, half:], is_yellow) > 100
        assert amount(picture[:, half:], is_blue) == 0


def test_picture_of_a_tip_without_mesh_and_robot(draw, content):
    picture = draw(content=replace(content, tool=None, robot=None), links={})
    assert amount(picture, is_blue) == 0
    assert amount(picture, is_red) > 1000


def test_robot_whose_links_are_unknown_is_left_out(draw):
    assert amount(draw(links={}), is_blue) == 0


def test_unknown_margin_is_grey(draw):
    picture = draw(MarginState.UNKNOWN)
    assert amount(picture, is_red) + amount(picture, is_green) == 0


def test_step_without_the_reference_leaves_the_robot_out(draw, edges):
    picture = draw(measured=edges[1:])
    assert amount(picture, is_blue) == 0
    assert amount(picture, is_red) > 1000


def test_tool_missing_in_the_frame_is_where_the_step_judged_it(draw, picture, edges, fixed):
    reference, needle, cautery = edges
    tumor_from_tip = (needle @ fixed[1]).inverse() @ cautery @ fixed[0]
    without_tool = draw(measured=(reference, needle), tumor_from_tip=tumor_from_tip)
    assert np.abs(without_tool - picture).max() < 0.02
    with pytest.raises(SceneError, match="step 0: frame 'cautery_tip' has no pose"):
        draw(measured=(reference, needle))
    with pytest.raises(SceneError, match="step 0: frame 'tumor' has no pose"):
        draw(measured=(reference, cautery))


def test_strip_has_its_colour_and_its_text():
    strip = state_strip("POSITIVE: in the tumour, -2.8 mm", (800, 64), SHOWN_STATES["POSITIVE"])
    assert strip.shape == (64, 800, 3)
    assert (strip[:, :10] == np.round(255.0 * np.array(MarginState.POSITIVE.color))).all()
    white = (strip == 255).all(axis=-1)
    assert 500 < white.sum() < 20000
    dark = state_strip("NEGATIVE", (800, 64), SHOWN_STATES["NEGATIVE"])
    assert (dark.max(axis=-1) < 60).any()
    assert state_strip("x" * 500, (800, 64), SHOWN_STATES["UNKNOWN"]).shape == (64, 800, 3)


def test_strip_has_the_symbol_of_its_state_without_any_text():
    drawn = [state_strip("", (200, 64), state) for state in SHOWN_STATES.values()]
    inked = [(strip != strip[0, 0]).any(axis=-1) for strip in drawn]
    assert all(20 < mask.sum() < 1000 for mask in inked)
    assert len({mask.tobytes() for mask in inked}) == len(SHOWN_STATES)


def test_png_round_trip():
    picture = np.random.default_rng(1).integers(0, 256, (5, 7, 3), dtype=np.uint8)
    assert np.array_equal(np.round(255 * imread(BytesIO(png(picture)))), picture)


def test_banner_of_an_aged_scene_is_grey(edges, fixed, tumor, decision):
    application = SceneApplication(vtkMRMLScene())
    scene = MarginGuardScene(application.scene, stale_after_ns=10)
    set_poses(scene, edges, fixed)
    scene.add_tumor(tumor)
    clear = decision(MarginState.NEGATIVE, 9.0)
    for now_ns, state in ((1, MarginState.NEGATIVE), (12, MarginState.UNKNOWN)):
        scene.show(clear, {}, now_ns)
        picture = imread(BytesIO(scene_png(application, scene, (200, 120))))
        assert np.allclose(picture[2, 2, :3], state.color, atol=0.01)
