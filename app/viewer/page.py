"""The page in the server: what the stage shows, and what is said beside the picture."""

from trame_server.state import State

from app.fixture import MarginState
from app.viewer.drawing.area import PictureArea
from app.viewer.drawing.cameras import CameraController
from app.viewer.drawing.scene_view import SceneView
from app.viewer.drawing.screenshot import screenshot
from app.viewer.readout.readout import readout
from app.viewer.readout.timeline import Timeline
from app.viewer.steps.feeds import Feed
from app.viewer.steps.view_state import ViewState


class Page:
    """Brings the stage to what ``feed`` says, and says the same in words with the same picture.

    ``state`` is trame's, which every open page sees. All calls are those of the page's thread.
    """

    def __init__(
        self, state: State, stage: SceneView, area: PictureArea, feed: Feed, timeline: Timeline
    ) -> None:
        self.stage = stage
        self.area = area
        self.cameraman = CameraController(stage)
        self._state = state
        self._feed = feed
        self._timeline = timeline
        self._now: ViewState | None = None
        self._drawn: object = None
        state.now = {**readout(None), **timeline.at(None), "number": 0}
        state.look = ""
        state.plot = None  # a name that comes later is never drawn by a page that is open

    def prepare(self) -> bool:
        """Bring the scene to the present; whether that changed anything."""
        now = self._now = self._feed.now()
        if self.area.was_grabbed():
            self.cameraman.let_go()
        if self.area.was_resized():
            self.cameraman.place_anew()
        moment = None if now is None else (now.step.index, now.silent)
        drawn, self._drawn = self._drawn, (moment, self._timeline.mark())
        if now is not None and drawn != self._drawn:
            self.stage.show(now)
        self.cameraman.follow()
        return drawn != self._drawn

    def screenshot(self) -> bytes:
        """The present as PNG, also where no page is open and nothing is drawn."""
        self.prepare()
        said = readout(self._now)
        measured = self._now is not None and self._now.distance_mm is not None
        told = f"{said['distance']} mm" if measured else said["why"]
        return screenshot(self.area, MarginState[said["state"]], f"{said['label']}: {told}")

    def sent(self, number: int) -> None:
        """Say what picture ``number`` shows."""
        look = self.cameraman.look
        with self._state as state:
            state.now = {**readout(self._now), **self._timeline.at(self._now), "number": number}
            state.look = "" if look is None else look.value
            state.update(self._timeline.news())
