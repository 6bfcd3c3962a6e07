"""What the hands on the page may do: each a trigger of trame that a button or a key calls."""

from collections.abc import Callable

from trame_server import Server

from app.viewer.drawing.cameras import CameraController, CameraPreset
from app.viewer.drawing.scene_view import Part, SceneView
from app.viewer.steps.replay import RATES, ReplayControl

Changed = Callable[[], None]
"""Called after each wish: something may be to draw."""


class StageHands:
    """Choose the camera, show and hide, make translucent."""

    def __init__(
        self, server: Server, stage: SceneView, cameraman: CameraController, changed: Changed
    ) -> None:
        self._state = server.state
        self._stage = stage
        self._cameraman = cameraman
        self._changed = changed
        self._state.looks = [look.value for look in CameraPreset]
        self._tell_parts()
        server.trigger("look")(self._look)
        server.trigger("part_visible")(self._visible)
        server.trigger("part_opacity")(self._opacity)

    def _look(self, name: str) -> None:
        self._cameraman.take(CameraPreset(name))
        self._changed()

    def _visible(self, name: str, visible: bool) -> None:
        self._stage.set_visible(Part[name], bool(visible))
        self._tell_parts()
        self._changed()

    def _opacity(self, name: str, opacity: float) -> None:
        self._stage.set_opacity(Part[name], float(opacity))
        self._tell_parts()
        self._changed()

    def _tell_parts(self) -> None:
        self._state.parts = [
            {
                "name": part.name,
                "label": part.value,
                "visible": self._stage.visible(part),
                "opacity": self._stage.opacity(part),
            }
            for part in self._stage.parts
        ]


class ReplayHands:
    """Play and pause, step, seek, set the rate."""

    def __init__(self, server: Server, control: ReplayControl, changed: Changed) -> None:
        self._control = control
        self._changed = changed
        server.state.rates = list(RATES)
        server.trigger("play")(self._play)
        server.trigger("step")(self._step)
        server.trigger("seek")(self._seek)
        server.trigger("rate")(self._rate)

    def _play(self) -> None:
        if self._control.playing:
            self._control.pause()
        else:
            self._control.play()
        self._changed()

    def _step(self, frames: int) -> None:
        self._control.step(int(frames))
        self._changed()

    def _seek(self, share: float) -> None:
        # A hand may leave the timeline at either end.
        self._control.seek(min(max(float(share), 0.0), 1.0))
        self._changed()

    def _rate(self, rate: float) -> None:
        self._control.set_rate(float(rate))
        self._changed()
