"""The picture that is on the page now, as a PNG file."""

from app.scene.pictures.pixels import png
from app.viewer.drawing.area import PictureArea


def screenshot(area: PictureArea) -> bytes:
    """Draw the view finely, in the size that it has on the page."""
    area.set_fine(True)
    pixels, _, _ = area.img_cols_rows
    return png(pixels)
