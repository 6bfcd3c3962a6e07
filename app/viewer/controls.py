"""Commands of the page, which its buttons and keys call: those that only operators may use."""

from collections.abc import Callable

from trame_server.state import State

from app.runtime import SeenHold
from app.viewer.drawing.cameras import CameraController, CameraPreset
from app.viewer.drawing.scene_view import Part, SceneView
from app.viewer.messages.checks import boolean, integer, number, one_of, text
from app.viewer.messages.commands import Commands
from app.viewer.messages.errors import RefusedError
from app.viewer.steps.live_operator import LiveOperator
from app.viewer.steps.replay import RATES, ReplayControl

Changed = Callable[[], None]
"""Called after each command, to draw again."""
_MAX_STEP = 1000
"""Frames of one step."""
_MAX_SEQ = 2**53 - 1
"""Largest integer that JavaScript represents."""
_MAX_NONCE = 2**64 - 1


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
        part = one_of(Part.__members__)
        commands.add("look", self._select_camera, one_of(self._state.looks))
        commands.add("part_visible", self._set_visible, part, boolean)
        commands.add("part_opacity", self._set_opacity, part, number(0.0, 1.0))

    def _select_camera(self, name: str) -> None:
        self._camera.select(CameraPreset(name))
        self._changed()

    def _set_visible(self, name: str, visible: bool) -> None:
        self._view.set_visible(Part[name], visible)
        self._publish_parts()
        self._changed()

    def _set_opacity(self, name: str, opacity: float) -> None:
        self._view.set_opacity(Part[name], opacity)
        self._publish_parts()
        self._changed()

    def _publish_parts(self) -> None:
        self._state.parts = [
            {
                "name": part.name,
                "label": part.value,
                "visible": self._view.visible(part),
                "opacity": self._view.opacity(part),
            }
            for part in self._view.parts
        ]


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


class LiveControls:
    """Re-arms a live session: ends the hold whose causes the page shows."""

    def __init__(self, commands: Commands, operator: LiveOperator) -> None:
        self._operator = operator
        commands.add("rearm", self._rearm, integer(0, _MAX_SEQ), text(len(str(_MAX_NONCE))))

    def _rearm(self, seq: int, nonce: str) -> None:
        if not (nonce.isascii() and nonce.isdecimal()) or not 0 < int(nonce) <= _MAX_NONCE:
            raise RefusedError("nonce: not that of a hold; expected the decimal number of one")
        self._operator.rearm(SeenHold(seq, int(nonce)))
