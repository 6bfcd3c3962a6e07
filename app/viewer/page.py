"""Server side of the page: the scene view, and the values and lists beside the picture."""

from collections.abc import Sequence
from typing import Any

from trame_server.state import State

from app.runtime import RecordingStatus, TipDirections
from app.session import SHOWN_STATES, BreachList, moment_text
from app.viewer.contour_part import ContourPart
from app.viewer.drawing.camera_controller import CameraController, orientation
from app.viewer.drawing.client_scene import ClientScene
from app.viewer.drawing.render_loop import PictureArea, screenshot
from app.viewer.drawing.scene_view import SceneView
from app.viewer.feeds import Feed
from app.viewer.guided_part import GuidedPart
from app.viewer.image_part import ImagePart, depth_values
from app.viewer.live_operator import LiveOperator
from app.viewer.page_values import (
    direction_values,
    item_values,
    readout,
    recording_values,
)
from app.viewer.plan_part import PlanPart
from app.viewer.pointer_parts import HandPart
from app.viewer.timeline import Timeline
from app.viewer.view_state import ViewState
from app.viewer.world_part import WorldPart
from app.workflow import CalibrationStatus, WorkflowState, next_step, workflow_steps
from app.workflow.workflow import EventNote, EventNotes


class Page:
    """Updates the scene view from ``feed``, and the values of the page together with its picture.

    Only the values of an image are published before the picture is drawn.

    ``state`` is trame's, which all open pages share. ``client_scene`` describes the scene for a
    page that draws it, else None. ``images``: None for a session without images; ``hand``: None
    where the mouse does not move the tool; ``contour``: None where no tumour can be contoured;
    ``notes`` are listed; ``operator`` is that of a live session; ``guided``: None in a replay;
    ``world``: None without a simulated one; ``plans``: None where none can be shown. All calls come
    from the page's thread.
    """

    def __init__(
        self,
        state: State,
        view: SceneView,
        area: PictureArea,
        feed: Feed,
        timeline: Timeline,
        client_scene: ClientScene | None = None,
        images: ImagePart | None = None,
        hand: HandPart | None = None,
        contour: ContourPart | None = None,
        notes: EventNotes | None = None,
        operator: LiveOperator | None = None,
        guided: GuidedPart | None = None,
        world: WorldPart | None = None,
        plans: PlanPart | None = None,
    ) -> None:
        self.view = view
        self.area = area
        self.camera = CameraController(view, has_inset=client_scene is None)
        self._state = state
        self._feed = feed
        self._timeline = timeline
        self._client_scene = client_scene
        self._images = images
        self._hand = hand
        self._contour = contour
        self._notes = notes or EventNotes()
        self._guided = guided
        self._world = world
        self._plans = plans
        state.world = state.approach = state.guidance = state.goal = None
        state.registration = None
        state.calibration = state.calibration_map = None
        state.ultrasound = state.ultrasound_image = state.hand = state.contour = None
        state.notes = []
        self._operator = operator
        state.recording = state.workflow = state.image_depth = None
        state.update(item_values(None))
        self.shown: ViewState | None = None
        """The state of the last `prepare`."""
        self._drawn: object = None
        state.now = {**readout(None), **timeline.values(None), "number": 0}
        state.look = ""
        state.surfaces, state.drawn, state.camera = {}, [], None
        self._breaches = BreachList()
        self._directions = TipDirections()
        state.directions, state.orientation, state.inset = [], None, ""
        state.breaches, state.doubts = breach_rows(self._breaches), []
        state.plot = None  # an open page does not draw names that are added later

    @property
    def _recording(self) -> RecordingStatus | None:
        return None if self._operator is None else self._operator.recording

    def prepare(self) -> bool:
        """Update the scene to the present; return True if anything changed."""
        now = self.shown = self._feed.now()
        if self.area.take_grabbed():
            self.camera.release()
        if self.area.take_resized():
            self.camera.reframe()
        moment = None if now is None else (now.step.index, now.silent, now.request)
        edited = None if self._contour is None else self._contour.revision
        guided = None if self._guided is None else self._guided.workflow.revision
        bodies = None if self._world is None else self._world.world.version
        plans = None if self._plans is None else self._plans.revision
        kind = None if self._images is None else self._images.kind
        notes = len(self._notes.entries)
        changed = self._timeline.revision(), edited, guided, notes, bodies, plans, kind
        drawn, self._drawn = self._drawn, (moment, *changed)
        if now is not None and drawn != self._drawn:
            self.view.show(now)
            if self._images is not None:
                frame = None if self._contour is None else self._contour.places.frame
                self._images.update(now, self.view, frame)
                with self._state as state:  # not with the picture, which takes longer to draw
                    state.update(self._images.values())
            if self._contour is not None:
                place = None if self._images is None else self._images.place
                self._contour.update(now, self.view, *(place or (None, None)))
            if self._guided is not None:
                self._guided.workflow.update(now.content)
            if self._world is not None and self._world.update(now, self.view):
                self.camera.frame_added()
            if self._plans is not None and self._plans.update(now, self.view):
                self.camera.frame_added()
        self.camera.update()
        self.view.sort()
        return drawn != self._drawn

    def screenshot(self) -> bytes:
        """Render the present as PNG, also while no page is open."""
        self.prepare()
        values = readout(self.shown)
        measured = self.shown is not None and self.shown.distance_mm is not None
        text = f"{values['distance']} mm" if measured else values["why"]
        if values["playback"]:
            text += ", PLAYBACK of a recording"
        return screenshot(self.area, SHOWN_STATES[values["shown"]], f"{values['label']}: {text}")

    def sent(self, number: int) -> None:
        """Publish the values that belong to picture ``number``."""
        preset = self.camera.preset
        with self._state as state:
            state.now = {
                **readout(self.shown),
                **self._timeline.values(self.shown),
                "number": number,
            }
            state.look = "" if preset is None else preset.value
            state.update(self._timeline.new_plot())
            state.update(self._new_lists())
            state.notes = note_rows(self._notes.entries, self._timeline)
            state.recording = recording_values(self._recording)
            state.update(item_values(self.shown))
            state.image_depth = depth_values(self.shown)
            state.workflow = self._workflow()
            state.directions = direction_values(self._directions, self.shown)
            state.orientation = self._orientation()
            has_inset = self.view.scene is not None and self.view.inset.is_shown
            state.inset = self.view.inset.side if has_inset else ""
            for part in (self._hand, self._contour, self._guided, self._world, self._plans):
                if part is not None:
                    state.update(part.values())
            if self._client_scene is not None:
                state.update(self._client_scene.new_surfaces())
                state.drawn = self._client_scene.drawn()
                state.camera = self._client_scene.camera()

    def _workflow(self) -> dict[str, object] | None:
        guided = self._guided
        return workflow_values(
            self.shown,
            is_live=guided is not None,
            has_images=self._images is not None and self._images.has_ultrasound,
            calibration=None if guided is None else guided.workflow.calibration.status(),
            recording=self._recording,
        )

    def _new_lists(self) -> dict[str, object]:
        """The lists of breaches and of doubts, the first only if it has changed."""
        listed = self._timeline.listed(self.shown)
        if listed is None:
            return {}
        lists: dict[str, object] = {"doubts": list(listed.doubts)}
        if listed.breach_list is not self._breaches:
            self._breaches = listed.breach_list
            lists["breaches"] = breach_rows(self._breaches)
        return lists

    def _orientation(self) -> dict[str, object] | None:
        """Letters and scale; None for a page that has turned its own camera."""
        is_own_camera = self._client_scene is not None and self.camera.preset is None
        return None if is_own_camera else orientation(self.view)


_MAX_ROWS = 50
"""The deepest breach and the last ones are listed, and the last notes."""


def breach_rows(breaches: BreachList) -> dict[str, Any]:
    """The number of breaches, and of each that is listed its time, depth, place and tool part."""
    deepest = breaches.deepest
    listed = breaches.entries[-_MAX_ROWS:]
    if deepest is not None and deepest not in listed:
        listed = (deepest, *listed[1:])
    return {
        "count": breaches.count,
        "rows": [
            {
                "n": entry.number,
                "frame": entry.deepest,
                "first": entry.first,
                "time": moment_text(entry.begin_ns, entry.begin_s),
                "depth": f"{entry.depth_mm:.1f} mm",
                "place": entry.place_text,
                "letters": entry.place,
                "part": entry.tool_text,
                "deepest": entry is deepest,
                "open": entry.is_open,
            }
            for entry in listed
        ],
    }


def note_rows(notes: Sequence[EventNote], timeline: Timeline) -> list[dict[str, Any]]:
    """Number, time, text and frame of each note, and its place ``x`` on the timeline."""
    return [
        {
            "n": note.number,
            "frame": note.frame,
            "time": moment_text(note.stamp_ns, note.begin_s),
            "text": note.text,
            "x": timeline.place(note),
        }
        for note in notes[-_MAX_ROWS:]
    ]


def workflow_values(
    shown: ViewState | None,
    *,
    is_live: bool,
    has_images: bool,
    calibration: CalibrationStatus | None,
    recording: RecordingStatus | None,
) -> dict[str, Any] | None:
    """Each step with what it needs, has and lacks; None before the first moment of a session."""
    if shown is None:
        return None
    steps = workflow_steps(
        shown.step,
        shown.content,
        is_live=is_live,
        silent=shown.silent,
        has_images=has_images,
        calibration=calibration,
        recording=recording,
    )
    following = next_step(steps)
    needed = [each for each in steps if each.is_needed]
    done = sum(each.state is WorkflowState.DONE for each in needed)
    return {
        "count": f"{done} of {len(needed)} done",
        "next": "" if following is None else following.name.value,
        "rows": [
            {
                "name": each.name.value,
                "state": each.state.value,
                "symbol": each.symbol,
                "needs": each.needs,
                "has": each.has,
                "problem": each.problem,
            }
            for each in steps
        ],
    }
