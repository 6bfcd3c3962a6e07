"""The present picture of the page as PNG."""

import numpy as np

from app.fixture import MarginState
from app.scene.pictures.offscreen_view import png, state_strip
from app.viewer.drawing.area import PictureArea

_BANNER_PIXELS = 44


def screenshot(area: PictureArea, state: MarginState, text: str) -> bytes:
    """Draw the view in high quality, in its size on the page, below a banner with ``text``.

    The banner has the colour and the symbol of ``state``, because the file is viewed without the
    page.
    """
    area.set_high_quality(True)
    pixels, width, _ = area.img_cols_rows
    return png(np.concatenate([state_strip(text, (width, _BANNER_PIXELS), state), pixels]))
