"""Pictures as arrays (height, width, 3) of bytes, the upper row first."""

import numpy as np
from numpy.typing import NDArray
from vtkmodules.vtkCommonDataModel import vtkImageData
from vtkmodules.vtkIOImage import vtkPNGWriter
from vtkmodules.vtkRenderingCore import vtkTextProperty, vtkTextRenderer

from app.scene.nodes.convert import numpy_array, vtk_array

Pixels = NDArray[np.uint8]

_DARK, _LIGHT = (0.08, 0.12, 0.16), (1.0, 1.0, 1.0)
_INDENT_PIXELS = 24
_DPI = 96


def pixels_of(image: vtkImageData) -> Pixels:
    """The bytes of a 2D image, whatever its number of components."""
    width, height, _ = image.GetDimensions()
    values = numpy_array(image.GetPointData().GetScalars())
    return np.array(values.reshape(height, width, -1)[::-1])  # a copy: the image may be gone soon


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


def text_strip(text: str, size: tuple[int, int], background: tuple[float, float, float]) -> Pixels:
    """``text`` in a strip of ``size`` (width, height), dark or light as the background wants."""
    width, height = size
    strip = np.empty((height, width, 3), dtype=np.uint8)
    strip[:] = np.round(255.0 * np.array(background))
    style = vtkTextProperty()
    style.SetFontFamilyToArial()
    style.SetBold(True)
    style.SetFontSize(round(0.36 * height))
    style.SetColor(*_readable_on(background))
    image = vtkImageData()
    vtkTextRenderer.GetInstance().RenderString(style, text, image, [0, 0], _DPI)
    letters = pixels_of(image)
    # The renderer's image is as large as the text or larger; what does not fit is cut off.
    rows = np.flatnonzero(letters[..., 3].any(axis=1))
    letters = letters[rows[0] : rows[-1] + 1, : width - _INDENT_PIXELS] if len(rows) else letters
    top = (height - letters.shape[0]) // 2
    place = strip[top : top + letters.shape[0], _INDENT_PIXELS : _INDENT_PIXELS + letters.shape[1]]
    cover = letters[..., 3:] / 255.0
    place[:] = np.round(cover * letters[..., :3] + (1.0 - cover) * place)
    return strip


def _readable_on(background: tuple[float, float, float]) -> tuple[float, float, float]:
    red, green, blue = background
    luminance = 0.2126 * red + 0.7152 * green + 0.0722 * blue
    return _DARK if luminance > 0.4 else _LIGHT
