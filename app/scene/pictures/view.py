"""A 3D view of an MRML scene that draws into memory, with Slicer's own displayable managers."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from slicer import vtkMRMLApplicationLogic
from vtkmodules.vtkRenderingCore import vtkWindowToImageFilter

from app.scene.application import SceneApplication
from app.scene.pictures.cameras import VIEW_ANGLE_DEG, look_through
from app.scene.pictures.framing import Camera
from app.scene.pictures.offscreen import use_offscreen_rendering
from app.scene.pictures.pixels import Pixels, pixels_of

if TYPE_CHECKING:
    from trame_slicer.views.abstract_view import AbstractView

_TOP = (0.97, 0.98, 0.99)
_BOTTOM = (0.84, 0.88, 0.92)


class OffscreenView:
    """Draws what Slicer's 3D view would show; `close` removes its view and camera nodes."""

    def __init__(
        self,
        application: SceneApplication,
        name: str,
        size: tuple[int, int],
    ) -> None:
        """``size`` in pixels. Raises `OffscreenError` where VTK cannot draw without a screen."""
        # Imported here: desktop Slicer imports this module, but has no trame-slicer.
        from trame_slicer.views.render_scheduler import NoScheduleRendering
        from trame_slicer.views.threed_view import ThreeDView

        use_offscreen_rendering()
        self._scene = application.scene
        self._view = ThreeDView(
            application.scene,
            application.logic,
            name,
            scheduled_render_strategy=NoScheduleRendering(),
        )
        self._size = size
        window = self._view.render_window()
        # Without a graphics card multi-sampling takes five times as long; FXAA is cheap.
        window.SetMultiSamples(0)
        window.SetSize(*size)
        self._view.renderer().SetUseFXAA(True)
        node = self._view.get_view_node()
        node.SetBoxVisible(False)
        node.SetAxisLabelsVisible(False)
        node.SetBackgroundColor(*_BOTTOM)
        node.SetBackgroundColor2(*_TOP)

    @property
    def aspect(self) -> float:
        """Width over height."""
        return self._size[0] / self._size[1]

    def look(self, camera: Camera) -> None:
        """Use ``camera`` from the next picture on."""
        look_through(self._view.get_camera_node(), camera, VIEW_ANGLE_DEG)
        self._view.renderer().ResetCameraClippingRange()

    def fill(self, color: tuple[float, float, float]) -> None:
        """Give the background one colour, without a gradient."""
        self._view.get_view_node().SetBackgroundColor(*color)
        self._view.get_view_node().SetBackgroundColor2(*color)

    def pixels(self) -> Pixels:
        """Draw, and return the picture."""
        self._view.renderer().ResetCameraClippingRange()
        self._view.render()
        grab = vtkWindowToImageFilter()
        grab.SetInput(self._view.render_window())
        grab.SetInputBufferTypeToRGB()
        grab.ReadFrontBufferOff()
        grab.ShouldRerenderOff()
        grab.Update()
        return pixels_of(grab.GetOutput())

    def close(self) -> None:
        """Free the window and remove the view's own nodes from the scene."""
        camera, node = self._view.get_camera_node(), self._view.get_view_node()
        self._view.set_view_node(None)  # otherwise it creates another camera
        self._view.finalize()
        self._scene.RemoveNode(camera)
        self._scene.RemoveNode(node)


def draw_once_per_update(
    logic: vtkMRMLApplicationLogic, view: "AbstractView"
) -> Callable[[], None]:
    """Let a view of trame-slicer not draw while ``logic`` pauses rendering, as in desktop Slicer.

    Every displayable manager requests a rendering at each change, some forty per update. Then the
    view makes one request, at the end of the update. Returns a function that ends this; call it
    before the view is closed.
    """
    blocked: list[bool] = []

    def pause(*_: object) -> None:
        blocked.append(view.set_render_blocked(True))

    def resume(*_: object) -> None:
        # A view that was created within an update has nothing to resume.
        if blocked and not blocked.pop():
            view.set_render_blocked(False)

    observers = (
        logic.AddObserver(vtkMRMLApplicationLogic.PauseRenderEvent, pause),
        logic.AddObserver(vtkMRMLApplicationLogic.ResumeRenderEvent, resume),
    )

    def stop() -> None:
        for observer in observers:
            logic.RemoveObserver(observer)

    return stop


@contextmanager
def offscreen_view(
    application: SceneApplication, name: str, size: tuple[int, int]
) -> Iterator[OffscreenView]:
    """An `OffscreenView` that is closed at the end."""
    view = OffscreenView(application, name, size)
    try:
        yield view
    finally:
        view.close()
