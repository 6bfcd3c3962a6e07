"""Commands of the page, which its buttons and keys call: those that only operators may use."""

from collections.abc import Callable, Sequence
from functools import partial

from trame_server.state import State

from app.case import DISPLAY_ITEMS, MAX_DEPTH_MM, ItemKind
from app.fixture import MarginParameters
from app.geometry import InputError
from app.geometry.frames import MAX_FRAME_CHARS
from app.runtime import (
    ITEM_COMMANDS,
    AddNote,
    ChooseDepth,
    OperatorCommand,
    Rearm,
    Record,
    SetMargins,
    SwitchStructure,
)
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

_MAX_STEP = 1000
"""Frames of one step."""
_MAX_SEQ = 2**53 - 1
"""Largest integer that JavaScript represents."""
_MAX_NONCE = 2**64 - 1
_MAX_RECORDING_NAME = 64
_MAX_LENGTH_STEP = 10.0
"""Largest change in mm of a rod's length at once."""
_MAX_STOP_MM, _MAX_WARN_MM = (MarginParameters.ranges()[name][1] for name in ("stop_mm", "warn_mm"))


def add_scene_controls(
    state: State, commands: Commands, view: SceneView, camera: CameraController
) -> None:
    """Select the camera preset, the visibility and the opacity of parts."""

    def keep_tumor(keep: bool) -> None:
        camera.keeps_tumor = state.keeps_tumor = keep

    def set_visible(name: str, visible: bool) -> None:
        view.set_visible(name, visible)
        publish_parts()

    def set_opacity(name: str, opacity: float) -> None:
        view.set_opacity(name, opacity)
        publish_parts()

    def publish_parts() -> None:
        state.parts = [
            {
                "name": part,
                "label": PARTS[part],
                "visible": view.visible(part),
                "opacity": view.opacity(part),
            }
            for part in view.parts
        ]

    state.looks = [preset.value for preset in CameraPreset]
    state.keeps_tumor = camera.keeps_tumor
    publish_parts()
    part = one_of(PARTS)
    commands.add("centre", keep_tumor, boolean)
    commands.add("look", lambda name: camera.select(CameraPreset(name)), one_of(state.looks))
    commands.add("part_visible", set_visible, part, boolean)
    commands.add("part_opacity", set_opacity, part, number(0.0, 1.0))


def add_marker_controls(state: State, commands: Commands, view: SceneView) -> None:
    """Distance and size of the breach marks, and their deletion. Display only."""

    def set_style(spacing_mm: float, size_mm: float) -> None:
        view.presenter.marker_style = MarkerStyle(spacing_mm, size_mm)
        publish()

    def publish() -> None:
        style = view.presenter.marker_style
        state.markers = {"spacing_mm": style.spacing_mm, "size_mm": style.size_mm}

    spacing = number(MIN_SPACING_MM, MAX_SPACING_MM)
    commands.add("markers", set_style, spacing, number(MIN_SIZE_MM, MAX_SIZE_MM))
    commands.add("markers_delete", view.presenter.delete_breach_marks)
    publish()


def add_replay_controls(state: State, commands: Commands, control: ReplayControl) -> None:
    """Play and pause, step, seek, go to a frame, and set the rate of a replay."""

    def play() -> None:
        if control.playing:
            control.pause()
        else:
            control.play()

    state.rates = list(RATES)
    commands.add("play", play)
    commands.add("step", control.step, integer(-_MAX_STEP, _MAX_STEP))
    # The pointer may leave the timeline at either end.
    commands.add("seek", lambda share: control.seek(min(max(share, 0.0), 1.0)), number(-1.0, 2.0))
    commands.add("frame", control.go_to, integer(0, control.frames - 1))
    commands.add("rate", control.set_rate, number(min(RATES), max(RATES)))


def add_image_controls(commands: Commands, images: ImagePart, kinds: Sequence[str]) -> None:
    """Selects which of ``kinds`` of images the page shows."""

    def select(kind: str) -> None:
        images.kind = kind

    commands.add("image_kind", select, one_of(kinds))


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
        self._ask("recording", Record(start, name.strip()))

    def _switch(self, name: str, on: bool, reason: str) -> None:
        self._ask("structure", SwitchStructure(name, on, reason.strip()))

    def _lengthen(self, name: str, by_mm: float) -> None:
        self._ask(name, ITEM_COMMANDS[name](by_mm))

    def _choose_depth(self, seen_mm: float, depth_mm: float) -> None:
        """Use ``depth_mm`` for new images, while the page has shown ``seen_mm`` as in use."""
        content = self._operator.content
        known = None if content is None else content.image_depth
        if known is not None and known.depth_mm != seen_mm:
            raise InputError(
                f"depth of the images: it is now {known.depth_mm:g} mm, and nothing was done; "
                "expected the same request again, after a look at it"
            )
        self._ask("depth of the images", ChooseDepth(depth_mm))

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
        self._ask("margins", SetMargins(stop_mm, warn_mm))

    def _rearm(self, seq: int, nonce: str) -> None:
        if not (nonce.isascii() and nonce.isdecimal()) or not 0 < int(nonce) <= _MAX_NONCE:
            raise RefusedError("nonce: not that of a hold; expected the decimal number of one")
        self._ask("re-arm", Rearm(seq, int(nonce)))

    def _ask(self, what: str, command: OperatorCommand) -> None:
        """Begin to carry ``command`` out. Raises `InputError` where the session is not ready."""
        if not self._operator.request(command):
            raise InputError(
                f"{what}: the session has not begun, or does not answer an earlier request yet; "
                "expected the request later"
            )


def add_note_controls(
    commands: Commands,
    notes: EventNotes,
    shown: Callable[[], ViewState | None],
    operator: LiveOperator | None,
) -> None:
    """Adds event notes on the moment that ``shown`` returns.

    The session of ``operator`` lists each with its requests, in its audit log too.
    """

    def add(line: str) -> None:
        moment = shown()
        if moment is None:
            raise InputError("note: there is no step yet; expected one")
        step = moment.step
        note = notes.add(step.index, step.frame.stamp.ns, moment.elapsed_s, line)
        if operator is not None:
            text = f"{note.text} (step {note.frame}, stamp {note.stamp_ns} ns)"
            operator.request(AddNote(text))

    commands.add("note", add, text(MAX_NOTE_CHARS))
