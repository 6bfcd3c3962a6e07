"""Commands of the page, which its buttons and keys call: those that only operators may use."""

from collections.abc import Callable, Sequence
from functools import partial

from trame_server.state import State

from app.case import DISPLAY_ITEMS, MAX_DEPTH_MM, ItemKind
from app.fixture import MarginParameters
from app.geometry import InputError
from app.geometry.frames import MAX_FRAME_CHARS
from app.runtime import ITEM_COMMANDS, ChooseDepth, Rearm, Record, SetMargins, SwitchStructure
from app.runtime.session_changes import MAX_REASON
from app.scene import MarkerStyle
from app.scene.margin_display import (
    MAX_SIZE_MM,
    MAX_SPACING_MM,
    MIN_SIZE_MM,
    MIN_SPACING_MM,
)
from app.viewer.drawing.camera_controller import CameraController, CameraPreset
from app.viewer.drawing.scene_view import PARTS, SceneView
from app.viewer.feeds import RATES, ReplayControl
from app.viewer.image_part import ImagePart
from app.viewer.live_operator import LiveOperator
from app.viewer.messages.checks import (
    Commands,
    RefusedError,
    boolean,
    integer,
    number,
    one_of,
    text,
)
from app.viewer.view_state import ViewState
from app.workflow.workflow import MAX_NOTE_CHARS, EventNotes

Changed = Callable[[], None]
"""Called after each command, to draw again."""
_MAX_STEP = 1000
"""Frames of one step."""
_MAX_SEQ = 2**53 - 1
"""Largest integer that JavaScript represents."""
_MAX_NONCE = 2**64 - 1
_MAX_RECORDING_NAME = 64
_LATER = (
    "the session has not begun, or does not answer an earlier request yet; expected the request "
    "later"
)
_MAX_LENGTH_STEP = 10.0
"""Largest change in mm of a rod's length at once."""
_MAX_STOP_MM, _MAX_WARN_MM = (MarginParameters.ranges()[name][1] for name in ("stop_mm", "warn_mm"))


class SceneControls:
    """Select the camera preset, the visibility and the opacity of parts."""

    def __init__(
        self,
        state: State,
        commands: Commands,
        view: SceneView,
        camera: CameraController,
        changed: Changed,
    ) -> None:
        self._state = state
        self._view = view
        self._camera = camera
        self._changed = changed
        self._state.looks = [preset.value for preset in CameraPreset]
        self._publish_parts()
        part = one_of(PARTS)
        self._state.keeps_tumor = camera.keeps_tumor
        commands.add("centre", self._keep_tumor, boolean)
        commands.add("look", self._select_camera, one_of(self._state.looks))
        commands.add("part_visible", self._set_visible, part, boolean)
        commands.add("part_opacity", self._set_opacity, part, number(0.0, 1.0))

    def _select_camera(self, name: str) -> None:
        self._camera.select(CameraPreset(name))
        self._changed()

    def _keep_tumor(self, keep: bool) -> None:
        self._camera.keeps_tumor = self._state.keeps_tumor = keep
        self._changed()

    def _set_visible(self, name: str, visible: bool) -> None:
        self._view.set_visible(name, visible)
        self._publish_parts()
        self._changed()

    def _set_opacity(self, name: str, opacity: float) -> None:
        self._view.set_opacity(name, opacity)
        self._publish_parts()
        self._changed()

    def _publish_parts(self) -> None:
        self._state.parts = [
            {
                "name": part,
                "label": PARTS[part],
                "visible": self._view.visible(part),
                "opacity": self._view.opacity(part),
            }
            for part in self._view.parts
        ]


class MarkerControls:
    """Distance and size of the breach marks, and their deletion. Display only."""

    def __init__(self, state: State, commands: Commands, view: SceneView, changed: Changed) -> None:
        self._state = state
        self._view = view
        self._changed = changed
        spacing = number(MIN_SPACING_MM, MAX_SPACING_MM)
        commands.add("markers", self._set_style, spacing, number(MIN_SIZE_MM, MAX_SIZE_MM))
        commands.add("markers_delete", self._delete)
        self._publish()

    def _set_style(self, spacing_mm: float, size_mm: float) -> None:
        self._view.marker_style = MarkerStyle(spacing_mm, size_mm)
        self._publish()
        self._changed()

    def _delete(self) -> None:
        self._view.delete_breach_marks()
        self._changed()

    def _publish(self) -> None:
        style = self._view.marker_style
        self._state.markers = {"spacing_mm": style.spacing_mm, "size_mm": style.size_mm}


class ReplayControls:
    """Play and pause, step, seek, go to a frame, and set the rate of a replay."""

    def __init__(
        self, state: State, commands: Commands, control: ReplayControl, changed: Changed
    ) -> None:
        self._control = control
        self._changed = changed
        state.rates = list(RATES)
        commands.add("play", self._play)
        commands.add("step", self._step, integer(-_MAX_STEP, _MAX_STEP))
        commands.add("seek", self._seek, number(-1.0, 2.0))
        commands.add("frame", self._go_to, integer(0, control.frames - 1))
        commands.add("rate", self._rate, number(min(RATES), max(RATES)))

    def _play(self) -> None:
        if self._control.playing:
            self._control.pause()
        else:
            self._control.play()
        self._changed()

    def _step(self, frames: int) -> None:
        self._control.step(frames)
        self._changed()

    def _seek(self, share: float) -> None:
        # The pointer may leave the timeline at either end.
        self._control.seek(min(max(share, 0.0), 1.0))
        self._changed()

    def _go_to(self, frame: int) -> None:
        self._control.go_to(frame)
        self._changed()

    def _rate(self, rate: float) -> None:
        self._control.set_rate(rate)
        self._changed()


class ImageControls:
    """Selects which of ``kinds`` of images the page shows."""

    def __init__(
        self, commands: Commands, images: ImagePart, kinds: Sequence[str], changed: Changed
    ) -> None:
        self._images = images
        self._changed = changed
        commands.add("image_kind", self._select, one_of(kinds))

    def _select(self, kind: str) -> None:
        self._images.kind = kind
        self._changed()


class LiveControls:
    """Re-arms a live session, whose hold the page shows; records it.

    Changes its margins, the lengths of its display items and the depth of its images, and switches
    its structures.
    """

    def __init__(self, commands: Commands, operator: LiveOperator) -> None:
        self._operator = operator
        commands.add("rearm", self._rearm, integer(0, _MAX_SEQ), text(len(str(_MAX_NONCE))))
        stop, warn = number(0.0, _MAX_STOP_MM), number(0.0, _MAX_WARN_MM)
        commands.add("margins", self._set_margins, stop, warn, stop, warn)
        commands.add("switch", self._switch, text(MAX_FRAME_CHARS), boolean, text(MAX_REASON))
        commands.add("record", self._record, boolean, text(_MAX_RECORDING_NAME))
        step = number(-_MAX_LENGTH_STEP, _MAX_LENGTH_STEP)
        for item in DISPLAY_ITEMS:
            if item.kind is ItemKind.ROD:
                commands.add(item.command, partial(self._lengthen, item.name), step)
        depth = number(0.0, MAX_DEPTH_MM)
        commands.add("image_depth", self._choose_depth, depth, depth)

    def _record(self, start: bool, name: str) -> None:
        if not self._operator.request(Record(start, name.strip())):
            raise InputError("recording: " + _LATER)

    def _switch(self, name: str, on: bool, reason: str) -> None:
        if not self._operator.request(SwitchStructure(name, on, reason.strip())):
            raise InputError("structure: " + _LATER)

    def _lengthen(self, name: str, by_mm: float) -> None:
        if not self._operator.request(ITEM_COMMANDS[name](by_mm)):
            raise InputError(f"{name}: {_LATER}")

    def _choose_depth(self, seen_mm: float, depth_mm: float) -> None:
        """Use ``depth_mm`` for new images, while the page has shown ``seen_mm`` as in use."""
        content = self._operator.content
        known = None if content is None else content.image_depth
        if known is not None and known.depth_mm != seen_mm:
            raise InputError(
                f"depth of the images: it is now {known.depth_mm:g} mm, and nothing was done; "
                "expected the same request again, after a look at it"
            )
        if not self._operator.request(ChooseDepth(depth_mm)):
            raise InputError("depth of the images: " + _LATER)

    def _set_margins(
        self, seen_stop: float, seen_warn: float, stop_mm: float, warn_mm: float
    ) -> None:
        """Change the margins that the page has shown as ``seen_stop`` and ``seen_warn``."""
        content = self._operator.content
        margins = None if content is None else content.margins
        if margins is not None and (margins.stop_mm, margins.warn_mm) != (seen_stop, seen_warn):
            raise InputError(
                f"margins: they are now {margins.stop_mm:g} and {margins.warn_mm:g} mm, and "
                "nothing was done; expected the same request again, after a look at them"
            )
        if stop_mm >= warn_mm:
            raise InputError(
                f"margins: stop {stop_mm:g} mm, warning {warn_mm:g} mm; expected a larger warning "
                "distance"
            )
        if not self._operator.request(SetMargins(stop_mm, warn_mm)):
            raise InputError("margins: " + _LATER)

    def _rearm(self, seq: int, nonce: str) -> None:
        if not (nonce.isascii() and nonce.isdecimal()) or not 0 < int(nonce) <= _MAX_NONCE:
            raise RefusedError("nonce: not that of a hold; expected the decimal number of one")
        if not self._operator.request(Rearm(seq, int(nonce))):
            raise InputError("re-arm: " + _LATER)


class NoteControls:
    """Adds event notes on the moment that ``shown`` returns.

    ``listed`` is called with the text of each; it lists those of a live session with its requests.
    """

    def __init__(
        self,
        commands: Commands,
        notes: EventNotes,
        shown: Callable[[], ViewState | None],
        listed: Callable[[str], None],
        changed: Changed,
    ) -> None:
        self._notes = notes
        self._shown = shown
        self._listed = listed
        self._changed = changed
        commands.add("note", self._add, text(MAX_NOTE_CHARS))

    def _add(self, line: str) -> None:
        shown = self._shown()
        if shown is None:
            raise InputError("note: there is no step yet; expected one")
        step = shown.step
        stamp_ns = step.frame.stamp.ns
        note = self._notes.add(step.index, stamp_ns, shown.elapsed_s, line)
        self._listed(f"{note.text} (step {note.frame}, stamp {note.stamp_ns} ns)")
        self._changed()
