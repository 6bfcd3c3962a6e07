"""The server side of the page, without a browser."""

import io
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from PIL import Image
from trame_server import Server

from app.fixture import MarginState
from app.viewer.drawing.camera_controller import CameraPreset
from app.viewer.drawing.render_loop import PictureArea
from app.viewer.drawing.scene_view import SceneView
from app.viewer.page import Page
from app.viewer.view_state import ViewState

pytestmark = pytest.mark.long


class FeedDouble:
    """A test double: a feed whose state the test sets; None at first."""

    shown: ViewState | None = None

    def now(self):
        return self.shown


class TimelineDouble:
    """A test double: a timeline with a new plot at every picture."""

    def values(self, shown):
        return {"cursor": 0}

    def new_plot(self):
        return {"plot": [1, 2, 3]}

    def listed(self, shown):
        return shown

    def revision(self):
        return None


def test_plot_is_in_the_state_before_its_first_points():
    state = Server().state  # trame's own
    nothing = cast(SceneView, SimpleNamespace(scene=None)), cast(PictureArea, None)
    page = Page(state, *nothing, FeedDouble(), TimelineDouble())
    assert state.has("plot")
    page.sent(1)
    assert state.plot == [1, 2, 3]


def test_screenshot_shows_the_present_without_an_open_page(can_draw, parts):
    """Pictures are drawn for open pages only: the scene view is still at the last picture."""
    scene_view, feed = SceneView(parts.content), FeedDouble()
    page = Page(Server().state, scene_view, PictureArea(scene_view.view), feed, TimelineDouble())

    def colors():
        pixels = np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB")).astype(int)
        picture = pixels[60:]  # below the banner
        green = (picture[..., 1] > 2 * picture[..., 0]) & (picture[..., 1] > 2 * picture[..., 2])
        return pixels[0, 0], int(green.sum())

    feed.shown = parts.feed.shown[0]
    page.camera.select(CameraPreset.CLOSE)
    banner, green = colors()
    assert np.abs(banner - 255.0 * np.array(MarginState.NEGATIVE.color)).max() <= 1
    assert green > 1000
    feed.shown = feed.shown.as_unknown("the session has failed")
    banner, green = colors()
    assert np.abs(banner - 255.0 * np.array(MarginState.UNKNOWN.color)).max() <= 1
    assert green == 0
