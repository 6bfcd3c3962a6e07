"""Tumour, stop margin and tool in the image, against the circles in which a plane cuts them."""

from dataclasses import replace

import numpy as np
import pytest

from app.case import open_case_images
from app.cli.process import SignalState
from app.cli.replay_page import replay_parts
from app.geometry import Transform
from app.runtime import ShownItem
from app.viewer.image_part import Ultrasound, eight_bits, ultrasound_values
from tests.case.images.sequences import some_pixels
from tests.case.images.ultrasound_case import (
    COLUMNS,
    INVALID,
    LOST,
    PIXEL_MM,
    PROBE_FROM_IMAGE,
    ROWS,
    write_ultrasound_case,
)
from tests.cli.small_case import FRAMES

pytestmark = pytest.mark.slow

BREACH = 20


@pytest.fixture(scope="module")
def parts(tmp_path_factory):
    folder = write_ultrasound_case(tmp_path_factory.mktemp("ultrasound") / "case")
    return replay_parts(folder, (), SignalState(), tip_only=False)


@pytest.fixture
def ultrasound(parts):
    images = open_case_images(parts.run.prepared.case)
    yield Ultrasound(images)
    images.close()


def radii(line, center):
    """Distances in mm of points of a line from ``center`` in pixels."""
    return PIXEL_MM * np.linalg.norm(line - center, axis=1)


def test_outlines_are_the_circles_of_ball_and_rod(parts, ultrasound):
    view = ultrasound.at(parts.feed.shown[BREACH], "needle")
    assert (view.problem, view.number) == ("", BREACH)
    needle_mm = 0.001 * (BREACH % 3)
    ball = ((needle_mm - PROBE_FROM_IMAGE[0, 3]) / PIXEL_MM, -PROBE_FROM_IMAGE[1, 3] / PIXEL_MM)
    (tumor,) = view.tumor
    assert np.abs(radii(tumor, ball) - 8.0).max() < 0.05  # triangles of 1.2 mm
    (margin,) = view.margin
    assert np.abs(radii(margin, ball) - 9.0).max() < 0.1
    # The rod stands on the plane z = -30, its axis along z.
    axis = np.array([6.5, 0.01 * BREACH]) - PROBE_FROM_IMAGE[:2, 3]
    (tool,) = view.tool
    assert np.abs(radii(tool, tuple(axis / PIXEL_MM)) - 1.5).max() < 0.02
    np.testing.assert_allclose(view.tip, [*(axis / PIXEL_MM), -30.0], atol=1e-6)
    assert view.closest is not None and view.closest.shape == (2, 2)


def test_outline_of_the_needle_is_a_circle_while_its_sensor_is_known(parts, ultrasound):
    shown = parts.feed.shown[BREACH]
    edge = Transform("needle", "needle_tip", np.eye(3), [4.0, 0.0, 20.0])
    needle = ShownItem("needle", "needle", 60.0, edge)
    with_needle = replace(shown, content=replace(shown.content, items=(needle,)))
    view = ultrasound.at(with_needle, "needle")
    (line,) = view.items["needle"]
    centre = (np.array([4.0, 0.0]) - PROBE_FROM_IMAGE[:2, 3]) / PIXEL_MM
    needle_px = 0.001 * (BREACH % 3) / PIXEL_MM
    found_mm = radii(line, (centre[0] + needle_px, centre[1]))
    assert (found_mm.min(), found_mm.max()) == pytest.approx((0.75, 0.75), abs=0.02)
    assert ultrasound_values(view, (COLUMNS, ROWS))["items"]["needle"].startswith("M")
    assert ultrasound.at(shown, "needle").items == {}
    lost = replace(edge, target="wire", source="wire_tip")
    other = replace(needle, frame="wire", frame_from_tip=lost)
    hidden = replace(shown, content=replace(shown.content, items=(other,)))
    assert ultrasound.at(hidden, "needle").items == {}


def test_image_of_each_frame_is_its_own(parts, ultrasound):
    pixels = some_pixels(FRAMES, ROWS, COLUMNS)
    for number in (0, 39, 3):
        view = ultrasound.at(parts.feed.shown[number], "needle")
        assert view.image is not None
        np.testing.assert_array_equal(eight_bits(view.image), pixels[number])


@pytest.mark.parametrize(
    ("frame", "problem"),
    [(INVALID, "has status INVALID"), (LOST, "tracker -> probe is OUT_OF_VIEW")],
)
def test_invalid_image_and_lost_probe_show_no_image(parts, ultrasound, frame, problem):
    view = ultrasound.at(parts.feed.shown[frame], "needle")
    assert problem in view.problem
    assert (view.image, view.matrix, view.tumor, view.tip) == (None, None, (), None)
    values = ultrasound_values(view, (COLUMNS, ROWS))
    assert (values["tumor"], values["tip"], values["time"]) == ("", None, "")


def test_silent_session_shows_no_image(parts, ultrasound):
    shown = parts.feed.shown[BREACH].as_unknown("the session has failed")
    assert ultrasound.at(shown, "needle").problem == "the session has failed"
    assert ultrasound.at(None, "needle").image is None
    assert ultrasound.at(parts.feed.shown[BREACH], None).image is None


def test_unknown_tool_leaves_the_image_without_lines(parts, ultrasound):
    shown = parts.feed.shown[BREACH]
    unknown = replace(shown.as_unknown("no tool"), silent="")
    view = ultrasound.at(unknown, "needle")
    assert view.image is not None
    assert (view.tumor, view.margin, view.tool, view.tip, view.closest) == ((), (), (), None, None)
