"""The names that an open page is told of."""

from typing import cast

from trame_server import Server

from app.viewer.drawing.area import PictureArea
from app.viewer.drawing.stage import Stage
from app.viewer.page import Page
from app.viewer.steps.shown import Shown


class FeedDouble:
    """A test double: a feed that has nothing to show."""

    def now(self) -> Shown | None:
        return None


class TimelineDouble:
    """A test double: a timeline with a new plot at every picture."""

    def at(self, shown: Shown | None) -> dict[str, int]:
        return {"cursor": 0}

    def news(self) -> dict[str, list[int]]:
        return {"plot": [1, 2, 3]}

    def mark(self) -> object:
        return None


def test_the_plot_has_its_name_before_its_first_points():
    state = Server().state  # trame's own
    nothing = cast(Stage, None), cast(PictureArea, None)  # neither is asked for anything here
    page = Page(state, *nothing, FeedDouble(), TimelineDouble())
    assert state.has("plot")
    page.sent(1)
    assert state.plot == [1, 2, 3]
