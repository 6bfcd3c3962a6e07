"""Encoded image that is sent once: no compression, little time."""

from io import BytesIO

from PIL import Image

from app.geometry import Pixels

QUICK_TYPE = "image/bmp"


def quick_image(pixels: Pixels) -> bytes:
    """Return ``pixels`` of 8 bits, (rows, columns) or (rows, columns, 3), as BMP, `QUICK_TYPE`.

    The speckle of ultrasound hardly compresses: PNG saves a third of the bytes or nothing, and
    takes ten times as long, in the thread that draws the page.
    """
    content = BytesIO()
    Image.fromarray(pixels).save(content, "BMP")
    return content.getvalue()
