"""PNG of an image that is sent once: little compression, little time."""

from io import BytesIO

from PIL import Image

from app.geometry import Pixels

_LEVEL = 1
"""Compression, from 0 to 9."""


def quick_png(pixels: Pixels) -> bytes:
    """Return ``pixels`` of 8 bits, (rows, columns) or (rows, columns, 3), as PNG.

    Pillow writes one channel as one, and takes the level of compression; `pixels.png` by VTK
    is slower.
    """
    content = BytesIO()
    Image.fromarray(pixels).save(content, "PNG", compress_level=_LEVEL)
    return content.getvalue()
