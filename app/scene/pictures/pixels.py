"""Pictures as arrays (height, width, 3) of bytes, upper row first."""

from functools import cache
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from vtkmodules.vtkCommonCore import VTK_FONT_FILE
from vtkmodules.vtkCommonDataModel import vtkImageData
from vtkmodules.vtkIOImage import vtkPNGWriter
from vtkmodules.vtkRenderingCore import vtkTextProperty, vtkTextRenderer

from app.fixture import MarginState
from app.scene.errors import SceneError
from app.scene.nodes.convert import numpy_array, vtk_array

Pixels = NDArray[np.uint8]

_INDENT_PIXELS = 24
_FONT_PER_HEIGHT = 0.36
_DPI = 96


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


def state_strip(text: str, size: tuple[int, int], state: MarginState) -> Pixels:
    """Strip of ``size`` (width, height) in the colour of ``state``: its symbol, then ``text``."""
    width, height = size
    strip = np.empty((height, width, 3), dtype=np.uint8)
    strip[:] = np.round(255.0 * np.array(state.color))
    ink = state.display.text_color
    end = _draw_text(strip, _INDENT_PIXELS, state.display.symbol, ink, _symbol_font())
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
