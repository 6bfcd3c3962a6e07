"""Passes the imaging depth that an operator chooses on to the images of a live session."""

from app.runtime.content import SessionContent
from app.runtime.outputs import PassiveOutput, StepTiming, SwitchContent
from app.session import LiveImages, StepResult


class ImageDepthOutput(PassiveOutput):
    """`Output` that places the images of ``images`` by the depth in use. It permits nothing."""

    def __init__(self, images: LiveImages, content: SessionContent) -> None:
        self._images = images
        self._depth = content.image_depth

    def publish(self, step: StepResult, timing: StepTiming) -> bool:
        """Nothing: images are placed when they arrive."""
        return True

    def prepare(self, content: SessionContent) -> SwitchContent:
        """Nothing is slow here: `ImageDepth` has checked that the depth is listed."""
        return self._use

    def _use(self, content: SessionContent) -> None:
        if content.image_depth is not None and content.image_depth != self._depth:
            self._images.choose_depth(content.image_depth.depth_mm)
        self._depth = content.image_depth
