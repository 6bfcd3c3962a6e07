"""Where clicks in images and the tool's tip are in the frame that the tumour moves with."""

from collections import OrderedDict

from app.fixture import MarginState
from app.geometry import FloatArray, FrameError, Transform
from app.runtime import SessionContent
from app.viewer.steps.view_state import ViewState

_MAX_IMAGES = 10_000
"""Images whose place is kept, so that points can be placed on one that a page has frozen."""


class ContourPlaces:
    """Places in ``frame``, the frame that the tumour moves with, of what a page has shown.

    ``number`` is that of the present image, None without one.
    """

    def __init__(self, content: SessionContent) -> None:
        self.frame = frame_from_tumor(content).target
        self.number: int | None = None
        self._images: OrderedDict[int, FloatArray] = OrderedDict()
        self._tip: FloatArray | None = None

    @property
    def tip_mm(self) -> FloatArray | None:
        """The tool's tip (3,); None while the state is UNKNOWN."""
        return self._tip

    def show(self, shown: ViewState | None, number: int | None, matrix: FloatArray | None) -> None:
        """Note the moment that is shown, with image ``number`` if it has a ``matrix`` (4, 4).

        ``matrix`` maps (column, row, 0) of the image to mm in `frame`.
        """
        self.number, self._tip = None, None
        if number is not None and matrix is not None:
            self.number = number
            self._images[number] = matrix
            self._images.move_to_end(number)
            while len(self._images) > _MAX_IMAGES:
                self._images.popitem(last=False)
        if shown is None or shown.silent:
            return
        step = shown.step
        if step.decision.state is not MarginState.UNKNOWN and step.tumor_from_tip is not None:
            edge = frame_from_tumor(shown.content)
            self._tip = (edge @ step.tumor_from_tip).translation_mm

    def matrix(self, number: int) -> FloatArray | None:
        """The map (4, 4) of an image that was shown; None for others."""
        return self._images.get(number)


def frame_from_tumor(content: SessionContent) -> Transform:
    """The edge from the tumour's frame to the one that it moves with."""
    for edge in content.static_edges:
        if edge.source == content.tumor.frame:
            return edge
    raise FrameError(f"static transforms: none places {content.tumor.frame!r}; expected one")
