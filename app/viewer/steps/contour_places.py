"""Where clicks in images and the tips of tools are in the frame that the tumour moves with."""

from collections import OrderedDict

from app.geometry import FloatArray, InputError
from app.runtime import SessionContent, TrackedTool, tip_mm
from app.session import StepResult
from app.viewer.steps.view_state import ViewState

_MAX_IMAGES = 10_000
"""Images whose place is kept, so that points can be placed on one that a page has frozen."""


class ContourPlaces:
    """Places in ``frame``, the frame that the tumour moves with, of what a page has shown.

    ``number`` is that of the present image, None without one.
    """

    def __init__(self, content: SessionContent) -> None:
        self.frame = content.frame_from_tumor.target
        self.number: int | None = None
        self._images: OrderedDict[int, FloatArray] = OrderedDict()
        self._content = content
        self._step: StepResult | None = None

    def tip_mm(self, tool: TrackedTool) -> FloatArray:
        """The tip (3,) of ``tool``. Raises `InputError` with why it is not known."""
        return tip_mm(self._step, self._content, tool, self.frame)

    @property
    def has_tip(self) -> bool:
        """True if the place of the guarded tool's tip is known."""
        try:
            self.tip_mm(TrackedTool.CAUTERY)
        except InputError:
            return False
        return True

    def show(self, shown: ViewState | None, number: int | None, matrix: FloatArray | None) -> None:
        """Note the moment that is shown, with image ``number`` if it has a ``matrix`` (4, 4).

        ``matrix`` maps (column, row, 0) of the image to mm in `frame`.
        """
        self.number, self._step = None, None
        if number is not None and matrix is not None:
            self.number = number
            self._images[number] = matrix
            self._images.move_to_end(number)
            while len(self._images) > _MAX_IMAGES:
                self._images.popitem(last=False)
        if shown is not None and not shown.silent:
            self._step, self._content = shown.step, shown.content

    def matrix(self, number: int) -> FloatArray | None:
        """The map (4, 4) of an image that was shown; None for others."""
        return self._images.get(number)
