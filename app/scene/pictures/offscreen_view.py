"""A 3D view of an MRML scene that draws into memory, with Slicer's own displayable managers.

Pictures are arrays (height, width, 3) of bytes, upper row first.
"""

from contextlib import closing
from functools import cache
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from slicer import (
    vtkMRMLScene,
    vtkSlicerApplicationLogic,
    vtkSlicerMarkupsLogic,
    vtkSlicerSegmentationsModuleLogic,
    vtkSlicerSequencesLogic,
)
from vtkmodules.vtkCommonCore import VTK_FONT_FILE, vtkCollection
from vtkmodules.vtkCommonDataModel import vtkImageData
from vtkmodules.vtkIOImage import vtkPNGWriter
from vtkmodules.vtkRenderingCore import vtkTextProperty, vtkTextRenderer, vtkWindowToImageFilter

from app.scene.convert import numpy_array, vtk_array
from app.scene.models import Rgb
from app.scene.offscreen import SceneError, use_offscreen_rendering
from app.scene.pictures.camera_views import VIEW_ANGLE_DEG, Camera, look_through
from app.session import ShownState

if TYPE_CHECKING:
    from trame_slicer.views.threed_view import ThreeDView

Pixels = NDArray[np.uint8]

_INDENT_PIXELS = 24
_FONT_PER_HEIGHT = 0.36
_DPI = 96
QUICK_TYPE = "image/bmp"
_TOP = (0.97, 0.98, 0.99)
_BOTTOM = (0.84, 0.88, 0.92)


def pixels_of(image: vtkImageData) -> Pixels:
    """The bytes of a 2D image with any number of components, copied."""
    width, height, _ = image.GetDimensions()
    values = numpy_array(image.GetPointData().GetScalars())
    return np.array(values.reshape(height, width, -1)[::-1])


def png(pixels: Pixels) -> bytes:
    """The picture as PNG."""
    height, width, _ = pixels.shape
    image = vtkImageData()
    image.SetDimensions(width, height, 1)
    colors = np.ascontiguousarray(pixels[::-1]).reshape(-1, 3)
    image.GetPointData().SetScalars(vtk_array(colors))
    writer = vtkPNGWriter()
    writer.WriteToMemoryOn()
    writer.SetInputData(image)
    writer.Write()
    return bytes(memoryview(writer.GetResult()))


def state_strip(text: str, size: tuple[int, int], state: ShownState) -> Pixels:
    """Strip of ``size`` (width, height) in the colour of ``state``: its symbol, then ``text``."""
    width, height = size
    strip = np.empty((height, width, 3), dtype=np.uint8)
    strip[:] = list(bytes.fromhex(state.ground_hex[1:]))
    red, green, blue = bytes.fromhex(state.text_hex[1:])
    ink = (red / 255.0, green / 255.0, blue / 255.0)
    end = _draw_text(strip, _INDENT_PIXELS, state.symbol, ink, _symbol_font())
    _draw_text(strip, end + height // 4, text, ink, None)
    return strip


def _draw_text(
    strip: Pixels, left: int, text: str, color: tuple[float, float, float], font: Path | None
) -> int:
    """Draw into ``strip`` from column ``left``, cut off at its right end; return the column after.

    ``font`` is a font file, None for VTK's Arial.
    """
    height, width, _ = strip.shape
    if not text:  # VTK makes no image of it
        return left
    style = vtkTextProperty()
    style.SetFontFamilyToArial()
    if font is not None:
        style.SetFontFamily(VTK_FONT_FILE)
        style.SetFontFile(str(font))
    style.SetBold(True)
    style.SetFontSize(round(_FONT_PER_HEIGHT * height))
    style.SetColor(*color)
    image = vtkImageData()
    vtkTextRenderer.GetInstance().RenderString(style, text, image, [0, 0], _DPI)
    letters = pixels_of(image)
    # The renderer's image is as large as the text or larger.
    rows, columns = (np.flatnonzero(letters[..., 3].any(axis=axis)) for axis in (1, 0))
    if not len(rows) or left >= width:
        return left
    letters = letters[rows[0] : rows[-1] + 1, : columns[-1] + 1][:height, : width - left]
    top = (height - letters.shape[0]) // 2
    place = strip[top : top + letters.shape[0], left : left + letters.shape[1]]
    cover = letters[..., 3:] / 255.0
    place[:] = np.round(cover * letters[..., :3] + (1.0 - cover) * place)
    return left + int(letters.shape[1])


@cache
def _symbol_font() -> Path:
    """DejaVu Sans Bold of matplotlib: VTK's own fonts have no check mark."""
    matplotlib = find_spec("matplotlib")  # found, not imported
    if matplotlib is None or matplotlib.origin is None:
        raise SceneError("matplotlib: not installed; expected its font DejaVuSans-Bold.ttf")
    return Path(matplotlib.origin).parent / "mpl-data/fonts/ttf/DejaVuSans-Bold.ttf"


def quick_image(pixels: NDArray[np.integer]) -> bytes:
    """Return ``pixels`` of 8 bits, (rows, columns) or (rows, columns, 3), as BMP, `QUICK_TYPE`.

    The speckle of ultrasound hardly compresses: PNG saves a third of the bytes or nothing, and
    takes ten times as long, in the thread that draws the page.
    """
    from PIL import Image  # the other pictures need no Pillow

    content = BytesIO()
    Image.fromarray(pixels).save(content, "BMP")
    return content.getvalue()


class SceneApplication:
    """Registers the logics of markups, segmentations and sequences for ``scene``.

    Create it before nodes are added to the scene, and keep it while a view of the scene is open.
    Desktop Slicer has these logics itself.
    """

    def __init__(self, scene: vtkMRMLScene) -> None:
        self.scene = scene
        self.logic = vtkSlicerApplicationLogic()
        self.logic.SetMRMLScene(scene)
        self.logic.SetViewLogics(vtkCollection())
        self.logic.SetSliceLogics(vtkCollection())
        # The application logic does not own them; without these references no markup is drawn.
        self._markups = vtkSlicerMarkupsLogic()
        # Registers the conversion from a voxel segment to a surface.
        self._segmentations = vtkSlicerSegmentationsModuleLogic()
        # Plays sequences: moves the nodes of a sequence browser.
        self._sequences = vtkSlicerSequencesLogic()
        for each in (self._markups, self._segmentations, self._sequences):
            each.SetMRMLScene(scene)
            each.SetMRMLApplicationLogic(self.logic)
        self.logic.SetModuleLogic("Markups", self._markups)
        self.logic.SetModuleLogic("Segmentations", self._segmentations)


def three_d_view(application: SceneApplication, name: str, bottom: Rgb, top: Rgb) -> "ThreeDView":
    """A view of the scene without box and labels, on a background from ``bottom`` to ``top``.

    It renders only on request. Raises `OffscreenError` where VTK cannot draw without a
    screen.
    """
    # Imported here: desktop Slicer imports this module, but has no trame-slicer.
    from trame_slicer.views.render_scheduler import NoScheduleRendering
    from trame_slicer.views.threed_view import ThreeDView

    use_offscreen_rendering()
    view = ThreeDView(
        application.scene,
        application.logic,
        name,
        scheduled_render_strategy=NoScheduleRendering(),
    )
    # Without a graphics card multi-sampling takes five times as long; FXAA is cheap.
    view.render_window().SetMultiSamples(0)
    node = view.get_view_node()
    node.SetBoxVisible(False)
    node.SetAxisLabelsVisible(False)
    node.SetBackgroundColor(*bottom)
    node.SetBackgroundColor2(*top)
    return view


class OffscreenView:
    """Draws what Slicer's 3D view would show; `close` removes its view and camera nodes."""

    def __init__(self, application: SceneApplication, name: str, size: tuple[int, int]) -> None:
        """``size`` in pixels. Raises `OffscreenError` where VTK cannot draw without a screen."""
        self._scene, self._size = application.scene, size
        self._view = three_d_view(application, name, _BOTTOM, _TOP)
        self._view.render_window().SetSize(*size)
        self._view.renderer().SetUseFXAA(True)

    @property
    def aspect(self) -> float:
        """Width over height."""
        return self._size[0] / self._size[1]

    def look(self, camera: Camera) -> None:
        """Use ``camera`` from the next picture on."""
        look_through(self._view.get_camera_node(), camera, VIEW_ANGLE_DEG)
        self._view.renderer().ResetCameraClippingRange()

    def fill(self, color: Rgb) -> None:
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


def offscreen_view(
    application: SceneApplication, name: str, size: tuple[int, int]
) -> "closing[OffscreenView]":
    """An `OffscreenView` that is closed at the end."""
    return closing(OffscreenView(application, name, size))
