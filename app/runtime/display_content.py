"""Images of a session and their depth, which displays alone use. No decision depends on them."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from app.case import (
    Case,
    DepthCalibration,
    ImageDepths,
    image_depths,
    stale_after_ns,
)
from app.geometry import InputError
from app.session import LiveImages

if TYPE_CHECKING:
    from app.runtime.content import SessionContent


@dataclass(frozen=True, slots=True)
class ImageDepth:
    """The listed depths, ascending, and the one by whose calibration new images are placed."""

    depths_mm: tuple[float, ...]
    depth_mm: float

    def chosen(self, depth_mm: float) -> "ImageDepth":
        """The same depths with ``depth_mm`` in use. Raises `InputError` for one not listed."""
        if depth_mm not in self.depths_mm:
            listed = ", ".join(f"{each:g}" for each in self.depths_mm)
            raise InputError(f"depth of the images: {depth_mm:g} mm; expected one of {listed}")
        return replace(self, depth_mm=depth_mm)


def image_depth_of(case: Case) -> ImageDepth | None:
    """The depths of ``case`` at its start; None for one without several calibrations."""
    entry = case.manifest.images
    if entry is None or entry.depth_mm is None:
        return None
    depths_mm = sorted(each.depth_mm or 0.0 for each in entry.calibrations)
    return ImageDepth(tuple(depths_mm), entry.depth_mm)


@dataclass(frozen=True, slots=True, eq=False)
class ImageDescription:
    """The images of a live session, as a display receives and places them.

    ``topic`` carries them, in ``orientation``. ``calibrations`` are of one probe; ``depth_mm`` is
    the one in use at the start. An image may be shown while it is at most ``stale_after_ns`` old,
    between poses at most ``max_gap_ns`` apart.
    """

    topic: str
    orientation: str
    calibrations: tuple[DepthCalibration, ...]
    depth_mm: float | None
    stale_after_ns: int
    max_gap_ns: int

    def images(self) -> LiveImages:
        """Images of such a session, none yet."""
        return LiveImages(
            self.depths(), stale_after_ns=self.stale_after_ns, max_gap_ns=self.max_gap_ns
        )

    def depths(self) -> ImageDepths:
        """The calibrations, with the one in use at the start."""
        return ImageDepths(self.calibrations, self.depth_mm)


def described_images(case: Case, topic: str) -> ImageDescription | None:
    """The images of the live session ``case``; None where it has none.

    ``topic`` carries those that do not come over a topic of their own. Raises `InputError` for a
    calibration that cannot be read.
    """
    entry = case.manifest.images
    if entry is None:
        return None
    depths = image_depths(case, entry)
    return ImageDescription(
        topic=entry.topic or topic,
        orientation=entry.orientation or "MF",
        calibrations=depths.calibrations,
        depth_mm=depths.depth_mm,
        stale_after_ns=stale_after_ns(case, entry),
        max_gap_ns=case.manifest.margins.stale_after_ns,
    )


ShownChange = Callable[["SessionContent"], tuple["SessionContent", str]]
"""From a content to the changed one, with a text on the change. Raises `InputError`."""


def other_depth(depth_mm: float) -> ShownChange:
    """Place images that are stamped from now on by the calibration of ``depth_mm``.

    Refused without listed depths, and for a depth that is not listed.
    """

    def change(content: "SessionContent") -> tuple["SessionContent", str]:
        known = content.image_depth
        if known is None:
            raise InputError(
                "depth of the images: the session has one calibration; expected "
                "'images.calibrations' in live.yaml"
            )
        depth = known.chosen(depth_mm)
        text = f"from {known.depth_mm:g} to {depth.depth_mm:g} mm"
        return replace(content, image_depth=depth), text

    return change
