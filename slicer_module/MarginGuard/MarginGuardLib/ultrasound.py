"""The ultrasound image of the shown session as a volume, and a slice view that follows it."""

from dataclasses import dataclass

from slicer import vtkMRMLScene, vtkMRMLSliceNode

from app.case import CurrentImage, ImageSource
from app.geometry import ImageSample, InputError
from app.runtime import ChooseDepth
from app.scene import ImageVolume, SceneError

from .live_step_run import LiveStepRun
from .shown_session import ShownSession

SLICE_VIEW = "Red"
NO_IMAGES = "no images"


@dataclass(frozen=True, slots=True)
class UltrasoundShown:
    """State of the image for the panel. ``depths_mm``: empty without several.

    ``depth_mm``: the one in use for new images. ``can_choose``: an operator may choose another.
    """

    text: str = NO_IMAGES
    has_images: bool = False
    depths_mm: tuple[float, ...] = ()
    depth_mm: float | None = None
    can_choose: bool = False
    is_frozen: bool = False
    follows: bool = False


class PanelUltrasound:
    """The image of ``session`` in ``mrml_scene``. Call it in the scene's thread.

    `update` follows each step that the panel shows; nothing waits for an image.
    """

    def __init__(self, session: ShownSession, mrml_scene: vtkMRMLScene) -> None:
        self._session = session
        self._mrml_scene = mrml_scene
        self._images: ImageSource | None = None
        self._sample: ImageSample | None = None
        self.volume: ImageVolume | None = None
        """The nodes; None before the first image."""
        self._view: vtkMRMLSliceNode | None = None
        self._is_frozen = False
        self._text = NO_IMAGES

    @property
    def pixel_mm(self) -> tuple[float, float] | None:
        """Width and height of a pixel of the shown image; None without one."""
        return None if self.volume is None else self.volume.pixel_mm

    def update(self) -> None:
        """Show the image of the present, or hide it where none is current."""
        run = None if self._session.thread is None else self._session.thread.run
        if self._images is None and isinstance(run, LiveStepRun):
            self._images = run.images
        if self._is_frozen and (self.volume is None or not self.volume.has_place):
            self._is_frozen = False  # the display was made anew
        if self._images is None or self._is_frozen:
            return
        problem = self._show(self._images)
        if problem:
            self._text = f"NO CURRENT IMAGE: {problem}"
            if self.volume is not None:
                self.volume.hide()
        elif self._view is not None and self.volume is not None:
            self.volume.align(self._view)

    def replay(self, images: ImageSource | None) -> None:
        """Show ``images`` of a recorded case, until `clear`."""
        self._images = images

    def freeze(self, freeze: bool) -> None:
        """Keep the present image, or follow again. A frozen one moves with the tumour's frame.

        Points that are placed on it are then right in that frame. Raises `InputError` without an
        image.
        """
        if freeze:
            self._keep()
        self._is_frozen = freeze

    def follow(self, follow: bool) -> None:
        """Let the red slice view follow the image, or leave it where it is."""
        self._view = None
        if follow:
            self._view = _slice_view(self._mrml_scene)
            self._fill(self._view)

    def choose_depth(self, depth_mm: float) -> None:
        """Place new images by the calibration of ``depth_mm``. `InputError` without a session."""
        self._session.request(ChooseDepth(depth_mm))

    def shown(self) -> UltrasoundShown:
        """The state of the image for the panel."""
        operator = self._session.operator
        depth = None if operator is None else operator.content.image_depth
        return UltrasoundShown(
            text=f"FROZEN: not current, {self._text}" if self._is_frozen else self._text,
            has_images=self._images is not None,
            depths_mm=() if depth is None else depth.depths_mm,
            depth_mm=None if depth is None else depth.depth_mm,
            can_choose=self._session.is_running and self._session.opened is None,
            is_frozen=self._is_frozen,
            follows=self._view is not None,
        )

    def clear(self) -> None:
        """Remove the nodes from the scene and close the images, as at the end of a session."""
        if self.volume is not None and self.volume.is_in_scene:
            self.volume.remove()
        close = getattr(self._images, "close", None)
        if close is not None:
            close()
        self._images = self._sample = self.volume = self._view = None
        self._is_frozen, self._text = False, NO_IMAGES

    def _show(self, images: ImageSource) -> str:
        """Show the newest image; return why none is current."""
        display, now_ns = self._session.display, self._session.present_ns
        if display is None or now_ns is None or self._session.silent:
            return self._session.silent or "tool and tumour have no place yet"
        try:
            root = display.reference_node()
        except SceneError as error:
            return str(error)
        found = images.at(now_ns, display.scene.reference)
        sample = self._pixels(images, found)
        if isinstance(sample, str):
            return sample
        volume = self._volume(is_color=sample.pixels.ndim == 3)
        volume.show(sample.pixels, found.pose.matrix, root)
        self._sample = sample
        depth = "" if found.depth_mm is None else f", depth {found.depth_mm:g} mm"
        self._text = f"image {found.number}{depth}"
        return ""

    def _pixels(self, images: ImageSource, found: CurrentImage) -> ImageSample | str:
        if found.number is None or found.pose.matrix is None:
            return found.pose.problem
        if self._sample is not None and self._sample.number == found.number:
            return self._sample
        try:
            sample = images.image(found.number)
        except InputError as error:  # a file that has changed, an image that newer ones replaced
            return str(error)
        return sample if sample.pixels is not None else "the image has no pixels"

    def _volume(self, *, is_color: bool) -> ImageVolume:
        known = self.volume
        if known is not None and (not known.is_in_scene or known.is_color is not is_color):
            if known.is_in_scene:
                known.remove()
            known = None
        if known is None:
            known = self.volume = ImageVolume(self._mrml_scene, is_color=is_color)
            if self._view is not None:
                self._fill(self._view)
        return known

    def _fill(self, view: vtkMRMLSliceNode) -> None:
        """Show the volume in ``view``."""
        if self.volume is None:
            return
        for index in range(self._mrml_scene.GetNumberOfNodesByClass("vtkMRMLSliceCompositeNode")):
            composite = self._mrml_scene.GetNthNodeByClass(index, "vtkMRMLSliceCompositeNode")
            if composite.GetLayoutName() == view.GetLayoutName():
                composite.SetBackgroundVolumeID(self.volume.node.GetID())
        self.volume.align(view)

    def _keep(self) -> None:
        """Place the shown image in the frame that the tumour moves with, by its own stamp."""
        display, sample = self._session.display, self._sample
        if self._images is None or display is None or self.volume is None or sample is None:
            raise InputError("image: none is shown; expected a current one")
        if not self.volume.visible:
            raise InputError(f"image: {self._text}; expected a current one")
        frame = self._session.started().content.frame_from_tumor.target
        found = self._images.at(sample.stamp.ns, frame)
        if found.number != sample.number or found.pose.matrix is None:
            raise InputError(
                f"image: its place in {frame} is not known: {found.pose.problem or 'a newer image'}"
                "; expected the same request again"
            )
        self.volume.show(sample.pixels, found.pose.matrix, display.frame_node(frame))


def _slice_view(scene: vtkMRMLScene) -> vtkMRMLSliceNode:
    for index in range(scene.GetNumberOfNodesByClass("vtkMRMLSliceNode")):
        node = scene.GetNthNodeByClass(index, "vtkMRMLSliceNode")
        if node.GetLayoutName() == SLICE_VIEW:
            return node
    raise InputError(f"the scene has no slice view {SLICE_VIEW}; expected one")
