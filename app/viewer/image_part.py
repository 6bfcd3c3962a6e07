"""The part of the page that shows images: the plane in the 3D view, and the image beside it."""

import base64
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from app.case import ImageSource
from app.files.volume_file import Volume
from app.fixture import MarginState
from app.geometry import NS_PER_S, FloatArray, ImageSample, InputError, Pixels
from app.scene import QUICK_TYPE, ImagePlane, MarginGuardScene, quick_image
from app.session import moment_text
from app.viewer.drawing.scene_view import SceneView
from app.viewer.image_cuts import (
    SIDE,
    ImageView,
    Lines,
    PlaneLines,
    Reslice,
    ReslicePlane,
    root_from_tumor,
)
from app.viewer.view_state import ViewState

_MAX_POINTS = 4000
"""Points of the lines on one image."""


def ultrasound_values(view: ImageView, size: tuple[int, int], begin_ns: int = 0) -> dict[str, Any]:
    """The values that the page draws of ``view``; ``size``: columns and rows.

    ``begin_ns``: stamp from which seconds count. Paths are those of SVG in pixels, from 0 at the
    outer edge of the first pixel.
    """
    stamp = None if view.image is None else view.image.stamp
    tip = None if view.tip is None else [round(float(value), 2) for value in view.tip]
    return {
        "number": view.number,
        "width": size[0],
        "height": size[1],
        "problem": view.problem,
        "time": "" if stamp is None else _time_text(stamp.ns, begin_ns, view.depth_mm),
        "tumor": svg_path(view.tumor),
        "margin": svg_path(view.margin),
        "tool": svg_path(view.tool),
        "items": {name: svg_path(lines) for name, lines in view.items.items()},
        "tip": None if tip is None else [tip[0] + 0.5, tip[1] + 0.5, tip[2]],
        "edges": view.edges,
        "closest": "" if view.closest is None else svg_path((view.closest,)),
    }


def depth_values(shown: ViewState | None) -> dict[str, Any] | None:
    """The listed depths in mm and the one in use for new images; None without several."""
    depth = None if shown is None else shown.content.image_depth
    return None if depth is None else {"depths": list(depth.depths_mm), "used": depth.depth_mm}


def _time_text(stamp_ns: int, begin_ns: int, depth_mm: float | None) -> str:
    depth = "" if depth_mm is None else f", depth {depth_mm:g} mm"
    return f"{moment_text(stamp_ns, (stamp_ns - begin_ns) / NS_PER_S)}{depth}"


def eight_bits(image: ImageSample) -> Pixels:
    """The pixels in 8 bits; others are stretched from the least to the largest value."""
    pixels = image.pixels
    if pixels is None:
        raise ValueError(f"image {image.number} has no pixels")
    if pixels.dtype == np.uint8:
        return pixels
    low, high = int(pixels.min()), int(pixels.max())
    scaled = (pixels.astype(np.float32) - low) * (255.0 / max(1, high - low))
    return np.round(scaled).astype(np.uint8)


def svg_path(lines: Lines | tuple[FloatArray, ...]) -> str:
    """The path of lines of points (n, 2), at most about `_MAX_POINTS` in all."""
    count = sum(len(line) for line in lines)
    step = max(1, -(-count // _MAX_POINTS))
    return "".join(
        "M" + "L".join(f"{x + 0.5:.2f} {y + 0.5:.2f}" for x, y in _thinned(line, step).tolist())
        for line in lines
    )


def _thinned(line: FloatArray, step: int) -> FloatArray:
    """Every ``step``-th point of ``line``, with the last one, which closes an outline."""
    if step == 1:
        return line
    return np.concatenate([line[:-1:step], line[-1:]])


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


ULTRASOUND = "ultrasound"


def image_kinds(images: ImageSource | None, volume: Volume | None) -> tuple[str, ...]:
    """The kinds of images that a page can show of them; the first one is shown at first."""
    planes = () if volume is None else tuple(plane.value for plane in ReslicePlane)
    return planes if images is None else (ULTRASOUND, *planes)


class ImagePart:
    """Shows ``images`` and cuts of ``volume`` in the page's thread, one kind at a time.

    The plane is hidden while no image is current. At least one of both is given.
    """

    def __init__(self, images: ImageSource | None, volume: Volume | None = None) -> None:
        self._ultrasound = None if images is None else Ultrasound(images)
        self._reslice = None if volume is None else Reslice(volume)
        self.kind = image_kinds(images, volume)[0]
        """The kind that is shown, one of `image_kinds`."""
        self._view = ImageView(None, None, "no image yet")
        self._plane: ImagePlane | None = None
        self._scene: MarginGuardScene | None = None
        self._sent: int | None = None
        self._begin_ns = 0
        self.place: tuple[int, FloatArray] | None = None
        """The number of the ultrasound image that is shown, and its map (4, 4) to mm.

        The map is to the ``frame`` of `update`. None if no image is shown, or one of another kind.
        """

    @property
    def has_ultrasound(self) -> bool:
        """True if there are ultrasound images, whatever is shown."""
        return self._ultrasound is not None

    def update(self, shown: ViewState | None, view: SceneView, frame: str | None = None) -> None:
        """Show the image of ``shown`` in the scene of ``view``, and place it in ``frame``."""
        scene = view.scene
        if shown is not None:
            self._begin_ns = shown.begin_ns
        if scene is not self._scene:
            if self._plane is not None:
                self._plane.remove()
            self._scene, self._plane = scene, None
        root = None if scene is None else scene.reference
        found = self._view = self._at(shown, root)
        placed = self._placed(shown, frame)
        if placed is not None and placed[0] != found.number:  # an image has come in between
            found = self._view = self._at(shown, root)
        self.place = placed if placed is not None and placed[0] == found.number else None
        if scene is None:
            return
        node = scene.tree.node(scene.reference)
        if self._plane is None and node is not None:
            self._plane = ImagePlane(scene.scene, node)
        if self._plane is None:
            return
        if found.image is None or found.matrix is None:
            self._plane.hide()
        else:
            self._plane.show(eight_bits(found.image), found.matrix)

    def _at(self, shown: ViewState | None, root: str | None) -> ImageView:
        if self.kind == ULTRASOUND and self._ultrasound is not None:
            return self._ultrasound.at(shown, root)
        assert self._reslice is not None
        return self._reslice.at(shown, root, ReslicePlane(self.kind))

    def _placed(self, shown: ViewState | None, frame: str | None) -> tuple[int, FloatArray] | None:
        """The present ultrasound image and its map (4, 4) to mm in ``frame``.

        None if none may be shown, or if the page shows another kind of image.
        """
        if self.kind != ULTRASOUND or self._ultrasound is None or frame is None:
            return None
        if shown is None or shown.silent or self._view.problem or self._view.number is None:
            return None
        found = self._ultrasound.images.at(shown.step.frame.stamp.ns, frame)
        if found.number is None or found.pose.matrix is None:
            return None
        return found.number, found.pose.matrix

    def values(self) -> dict[str, Any]:
        """The values of the page that belong to the last `update`; the image if it is another."""
        image, size = self._view.image, (SIDE, SIDE)
        if self.kind == ULTRASOUND and self._ultrasound is not None:
            size = self._ultrasound.images.size or (1, 1)
        values = {"kind": self.kind, **ultrasound_values(self._view, size, self._begin_ns)}
        found: dict[str, Any] = {"ultrasound": values}
        if image is not None and image.number != self._sent:
            self._sent = image.number
            content = base64.b64encode(quick_image(eight_bits(image))).decode()
            found["ultrasound_image"] = {
                "number": image.number,
                "src": f"data:{QUICK_TYPE};base64,{content}",
            }
        return found
