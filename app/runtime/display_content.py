"""Content that displays alone use: needle, stylus, imaging depth. No decision depends on it."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from app.case import (
    MAX_NEEDLE_MM,
    MAX_STYLUS_SIGMA_MM,
    MIN_NEEDLE_MM,
    MIN_STYLUS_MM,
    Case,
    DepthCalibration,
    ImageDepths,
    image_depths,
    stale_after_ns,
)
from app.geometry import FloatArray, FrameError, InputError, SurfaceMesh, Transform
from app.hold import tip_change_text
from app.session import LiveImages

if TYPE_CHECKING:
    from app.runtime.content import SessionContent

_SIDES = 16


def pointed_rod(length_mm: float, radius_mm: float, point_mm: float, frame: str) -> SurfaceMesh:
    """A rod along z in ``frame``, its tip at 0 and its other end at ``-length_mm``.

    The last ``point_mm``, or half of a shorter rod, are a cone.
    """
    angle = np.linspace(0.0, 2.0 * np.pi, _SIDES, endpoint=False)
    circle = radius_mm * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    heights = -length_mm, -min(point_mm, 0.5 * length_mm)
    rings = [np.column_stack([circle, np.full(_SIDES, height)]) for height in heights]
    poles = np.array([[0.0, 0.0, -length_mm], [0.0, 0.0, 0.0]])
    low = np.arange(_SIDES)
    following = (low + 1) % _SIDES
    back, tip = np.full(_SIDES, 2 * _SIDES), np.full(_SIDES, 2 * _SIDES + 1)
    faces = [
        (back, following, low),
        (low, following, following + _SIDES),
        (low, following + _SIDES, low + _SIDES),
        (low + _SIDES, following + _SIDES, tip),
    ]
    corners = np.concatenate([np.stack(each, axis=1) for each in faces])
    return SurfaceMesh(frame, np.concatenate([*rings, poles]), corners.astype(np.int32))


NEEDLE_RADIUS_MM = 0.75
"""Radius of a needle that is drawn without a model of its own."""

_NEEDLE_POINT_MM = 4.0


@dataclass(frozen=True, slots=True, eq=False)
class Needle:
    """A needle of ``length_mm`` from its sensor to its tip.

    ``frame_from_tip``: the tip in the tracked frame of the sensor, +z forward. ``surface`` is in
    the frame of the tip; ``is_generated``: it follows the length.
    """

    length_mm: float
    frame_from_tip: Transform
    surface: SurfaceMesh
    is_generated: bool

    def with_length(self, length_mm: float) -> "Needle":
        """The same needle with another length. Raises `InputError` for one out of range."""
        if not MIN_NEEDLE_MM <= length_mm <= MAX_NEEDLE_MM:
            raise InputError(
                f"needle: a length of {length_mm:.6g} mm; expected {MIN_NEEDLE_MM:g} to "
                f"{MAX_NEEDLE_MM:g} mm"
            )
        known = self.frame_from_tip
        forward = known.rotation[:, 2]
        return replace(
            self,
            length_mm=length_mm,
            frame_from_tip=Transform(
                known.target, known.source, known.rotation, length_mm * forward
            ),
            surface=thin_needle(length_mm, known.source) if self.is_generated else self.surface,
        )


def needle_of(case: Case) -> Needle | None:
    """The needle of ``case``; None without one. Raises `MarginGuardError` for a broken model."""
    entry = case.manifest.needle
    if entry is None:
        return None
    rotation, model = _turned_from_z(np.array(entry.direction)), case.needle_mesh()
    return Needle(
        entry.length_mm,
        Transform(entry.frame, entry.tip_frame, rotation, entry.length_mm * rotation[:, 2]),
        thin_needle(entry.length_mm, entry.tip_frame) if model is None else model,
        is_generated=model is None,
    )


def thin_needle(length_mm: float, frame: str) -> SurfaceMesh:
    """A closed needle along z in ``frame``, its tip at 0 and its other end at ``-length_mm``."""
    return pointed_rod(length_mm, NEEDLE_RADIUS_MM, _NEEDLE_POINT_MM, frame)


def _turned_from_z(direction: FloatArray) -> FloatArray:
    """A rotation (3, 3) of z to the unit vector ``direction`` (3,); the smallest one for z >= 0."""
    x, y, z = direction
    if z < 0.0:
        half_turn = np.diag([1.0, -1.0, -1.0])
        return np.asarray(half_turn @ _turned_from_z(half_turn @ direction))
    cross = np.array([[0.0, 0.0, x], [0.0, 0.0, y], [-x, -y, 0.0]])
    rotation: FloatArray = np.eye(3) + cross + cross @ cross / (1.0 + z)
    return rotation


_STYLUS_RADIUS_MM, _STYLUS_POINT_MM, _MAX_STYLUS_MM = 2.0, 15.0, 150.0


@dataclass(frozen=True, slots=True, eq=False)
class Stylus:
    """A stylus whose sensor is tracked as ``frame``.

    ``frame_from_tip`` is the tip in that frame, +z forward; None while it is not calibrated.
    ``sigma_mm``: standard deviation of the tip in its worst direction, 0 where it is not stated.
    ``surface``, in the frame of the tip, is what is drawn; None without a tip.
    """

    frame: str
    frame_from_tip: Transform | None = None
    sigma_mm: float = 0.0
    surface: SurfaceMesh | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        if self.frame_from_tip is not None:
            length_mm = float(np.linalg.norm(self.frame_from_tip.translation_mm))
            rod = min(length_mm, _MAX_STYLUS_MM), _STYLUS_RADIUS_MM, _STYLUS_POINT_MM
            object.__setattr__(self, "surface", pointed_rod(*rod, self.tip_frame))

    @property
    def tip_frame(self) -> str:
        """The frame of the tip and of the surface."""
        return f"{self.frame}_tip"

    @property
    def tip(self) -> Transform:
        """``frame_from_tip``. Raises `InputError` for a stylus that is not calibrated."""
        if self.frame_from_tip is None:
            raise InputError("stylus: it is not calibrated; expected a pivot calibration before")
        return self.frame_from_tip

    def with_tip(self, frame_from_tip: Transform, sigma_mm: float) -> "Stylus":
        """The same stylus with a calibrated tip.

        Raises `FrameError` for a tip between other frames, and `InputError` for one at the
        sensor's origin or with an uncertainty out of range.
        """
        if (frame_from_tip.target, frame_from_tip.source) != (self.frame, self.tip_frame):
            raise FrameError(
                f"stylus: the tip is {frame_from_tip.target}_from_{frame_from_tip.source}; "
                f"expected {self.frame}_from_{self.tip_frame}"
            )
        length_mm = float(np.linalg.norm(frame_from_tip.translation_mm))
        if length_mm < MIN_STYLUS_MM:
            raise InputError(
                f"stylus: the tip is {length_mm:.3g} mm from the sensor's origin; expected "
                f"{MIN_STYLUS_MM:g} mm or more"
            )
        if not 0.0 <= sigma_mm <= MAX_STYLUS_SIGMA_MM:
            raise InputError(
                f"uncertainty of the stylus' tip: is {sigma_mm:.6g} mm; expected 0 to "
                f"{MAX_STYLUS_SIGMA_MM:g} mm"
            )
        return replace(self, frame_from_tip=frame_from_tip, sigma_mm=sigma_mm)


def stylus_of(case: Case) -> Stylus | None:
    """The stylus of ``case``; None without one."""
    entry = case.manifest.stylus
    return None if entry is None else Stylus(entry.frame, entry.frame_from_tip, entry.sigma_mm)


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


def longer_needle(by_mm: float) -> ShownChange:
    """Show the needle longer by ``by_mm``; refused without one and for a length out of range."""

    def change(content: "SessionContent") -> tuple["SessionContent", str]:
        known = content.needle
        if known is None:
            raise InputError("needle: the session has none; expected 'needle' in live.yaml")
        needle = known.with_length(known.length_mm + by_mm)
        text = f"from {known.length_mm:g} to {needle.length_mm:g} mm"
        return replace(content, needle=needle), text

    return change


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


def other_stylus_tip(frame_from_tip: Transform, sigma_mm: float) -> ShownChange:
    """Use this tip of the stylus; refused without a stylus, and as `Stylus.with_tip`."""

    def change(content: "SessionContent") -> tuple["SessionContent", str]:
        known = content.known_stylus
        stylus = known.with_tip(frame_from_tip, sigma_mm)
        before = known.frame_from_tip
        text = "the first tip" if before is None else tip_change_text(before, frame_from_tip)
        return replace(content, stylus=stylus), f"{text}, sigma {sigma_mm:.2f} mm"

    return change
