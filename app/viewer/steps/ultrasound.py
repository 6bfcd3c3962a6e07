"""The ultrasound image that belongs to what the page shows, with what is drawn on it."""

from dataclasses import dataclass, field

from app.case import ImageSource
from app.fixture import MarginState
from app.geometry import ImageSample, InputError
from app.viewer.steps.plane_lines import ImageView, PlaneLines, root_from_tumor
from app.viewer.steps.view_state import ViewState


@dataclass(slots=True)
class Ultrasound:
    """Finds the image of a moment, and cuts tumour, stop margin and tool by its plane.

    Not thread-safe: the page's thread owns it. One image is held at a time.
    """

    images: ImageSource
    _sample: ImageSample | None = None
    _lines: PlaneLines = field(default_factory=PlaneLines)

    def image(self, number: int) -> ImageSample:
        """Image ``number``; the last one is kept."""
        if self._sample is None or self._sample.number != number:
            self._sample = self.images.image(number)
        return self._sample

    def at(self, shown: ViewState | None, root: str | None) -> ImageView:
        """The image of the step of ``shown`` in the frame ``root`` of the scene.

        ``shown`` None, or ``root`` None: there is nothing to be placed in.
        """
        if shown is None or root is None:
            return ImageView(None, None, "tool and tumour have no place yet")
        if shown.silent:
            return ImageView(None, None, shown.silent)
        found = self.images.at(shown.step.frame.stamp.ns, root)
        matrix = found.pose.matrix
        if matrix is None or found.number is None:
            return ImageView(None, None, found.pose.problem, found.number)
        try:
            sample = self.image(found.number)
        except InputError as error:  # a file that has changed, an image that newer ones replaced
            return ImageView(None, None, str(error), found.number)
        view = ImageView(sample, matrix, "", found.number, depth_mm=found.depth_mm)
        step, tumor = shown.step, root_from_tumor(shown, root)
        if (
            step.decision.state is MarginState.UNKNOWN
            or step.tumor_from_tip is None
            or tumor is None
        ):
            return view
        return self._lines.added(view, shown, tumor, step.tumor_from_tip)
