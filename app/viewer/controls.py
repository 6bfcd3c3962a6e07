"""Commands of the page, as triggers of trame that buttons and keys call."""

from collections.abc import Callable

from trame_server import Server

from app.viewer.drawing.cameras import CameraController, CameraPreset
from app.viewer.drawing.scene_view import Part, SceneView
from app.viewer.steps.replay import RATES, ReplayControl

Changed = Callable[[], None]
"""Called after each command, to draw again."""


class SceneControls:
    """Select the camera preset, the visibility and the opacity of parts."""

    def __init__(
        self, server: Server, view: SceneView, camera: CameraController, changed: Changed
    ) -> None:
        self._state = server.state
        self._view = view
        self._camera = camera
        self._changed = changed
        self._state.looks = [preset.value for preset in CameraPreset]
        self._publish_parts()
        server.trigger("look")(self._select_camera)
        server.trigger("part_visible")(self._set_visible)
        server.trigger("part_opacity")(self._set_opacity)

    def _select_camera(self, name: str) -> None:
        self._camera.select(CameraPreset(name))
        self._changed()

    def _set_visible(self, name: str, visible: bool) -> None:
        self._view.set_visible(Part[name], bool(visible))
        self._publish_parts()
        self._changed()

    def _set_opacity(self, name: str, opacity: float) -> None:
        self._view.set_opacity(Part[name], float(opacity))
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
    """Play and pause, step, seek, and set the rate of a replay."""

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
        # The pointer may leave the timeline at either end.
        self._control.seek(min(max(float(share), 0.0), 1.0))
        self._changed()

    def _rate(self, rate: float) -> None:
        self._control.set_rate(float(rate))
        self._changed()
