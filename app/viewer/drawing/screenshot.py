"""The picture that is on the page now, as a PNG file."""

import numpy as np

from app.fixture import MarginState
from app.scene.pictures.pixels import png, state_strip
from app.viewer.drawing.area import PictureArea

_BANNER_PIXELS = 44


def screenshot(area: PictureArea, state: MarginState, words: str) -> bytes:
    """Draw the view finely, in the size that it has on the page, with ``words`` above it.

    The words stand in the colour of ``state``: a file is looked at without the page.
    """
    area.set_fine(True)
    pixels, width, _ = area.img_cols_rows
    return png(np.concatenate([state_strip(words, (width, _BANNER_PIXELS), state), pixels]))
