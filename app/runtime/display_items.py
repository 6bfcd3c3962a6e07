"""Items, images and depths that displays alone use. No decision depends on any of them.

`app.case.DISPLAY_ITEMS` declares the items: where their tips are, what is drawn, how an operator
changes them.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from app.case import (
    DISPLAY_ITEMS,
    MAX_POINTER_SIGMA_MM,
    MAX_ROD_MM,
    MIN_POINTER_MM,
    MIN_ROD_MM,
    Case,
    DepthCalibration,
    DisplayItem,
    ImageDepths,
    ItemKind,
    PointerEntry,
    image_depths,
    stale_after_ns,
)
from app.geometry import FloatArray, FrameError, InputError, SurfaceMesh, Transform
from app.robot.primitives import revolved
from app.session import LiveImages

if TYPE_CHECKING:
    from app.runtime.content import SessionContent


_DECLARED = {each.name: each for each in DISPLAY_ITEMS}
_SIDES = 16


def pointed_rod(length_mm: float, radius_mm: float, point_mm: float, frame: str) -> SurfaceMesh:
    """A closed rod along z in ``frame``, its tip at 0 and its other end at ``-length_mm``.

    The last ``point_mm``, or half of a shorter rod, are a cone.
    """
    heights = np.array([-length_mm, -length_mm, -min(point_mm, 0.5 * length_mm), 0.0])
    vertices, faces = revolved(np.array([0.0, radius_mm, radius_mm, 0.0]), heights, _SIDES)
    return SurfaceMesh(frame, vertices, faces.astype(np.int32))


@dataclass(frozen=True, slots=True, eq=False)
class ShownItem:
    """The item ``name`` of a session, whose sensor is tracked as ``frame``.

    ``frame_from_tip`` is the tip in that frame, +z forward, ``length_mm`` from the sensor; None
    while it is not calibrated. ``sigma_mm``: standard deviation of the tip in its worst direction,
    0 where it is not stated. ``model`` is the surface of a file; None for a generated one.
    ``surface`` is what is drawn, in the frame of the tip; None without a tip.
    """

    name: str
    frame: str
    length_mm: float = 0.0
    frame_from_tip: Transform | None = None
    sigma_mm: float = 0.0
    model: SurfaceMesh | None = None
    surface: SurfaceMesh | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        if self.name not in _DECLARED:
            known = ", ".join(_DECLARED)
            raise InputError(f"display item: is {self.name[:40]!r}; expected one of {known}")
        if self.frame_from_tip is not None:
            made, by = self.model, self.declared
            if made is None:
                drawn_mm = min(self.length_mm, by.drawn_mm)
                made = pointed_rod(drawn_mm, by.radius_mm, by.point_mm, self.tip_frame)
            object.__setattr__(self, "surface", made)

    @property
    def declared(self) -> DisplayItem:
        """Its declaration."""
        return _DECLARED[self.name]

    @property
    def is_pointer(self) -> bool:
        """True if an operator calibrates its tip and touches points with it."""
        return self.declared.kind is ItemKind.POINTER

    @property
    def tip_frame(self) -> str:
        """The frame of the tip and of the surface."""
        return f"{self.frame}_tip"

    @property
    def tip(self) -> Transform:
        """``frame_from_tip``. Raises `InputError` for a tip that is not calibrated."""
        if self.frame_from_tip is None:
            raise InputError(
                f"{self.name}: it is not calibrated; expected a pivot calibration before"
            )
        return self.frame_from_tip

    @property
    def text(self) -> str:
        """Length of a rod in mm; of a pointer how well its tip is known."""
        if not self.is_pointer:
            return f"{self.length_mm:g}"
        if self.frame_from_tip is None:
            return "not calibrated"
        sigma = f"sigma {self.sigma_mm:.2f} mm" if self.sigma_mm else "uncertainty not known"
        return f"tip {self.length_mm:.1f} mm from the sensor, {sigma}"

    @property
    def keys(self) -> dict[str, Any]:
        """The keys of ``case.yaml`` that an operator can have changed."""
        if not self.is_pointer:
            return {"length_mm": self.length_mm}
        if self.frame_from_tip is None:
            return {}
        matrix = self.frame_from_tip.matrix.ravel().tolist()
        return {"tip_from": {"matrix": matrix}, "sigma_mm": self.sigma_mm}

    def with_length(self, length_mm: float) -> "ShownItem":
        """The same rod with another length. Raises `InputError` for one out of range."""
        if not MIN_ROD_MM <= length_mm <= MAX_ROD_MM:
            raise InputError(
                f"{self.name}: a length of {length_mm:.6g} mm; expected {MIN_ROD_MM:g} to "
                f"{MAX_ROD_MM:g} mm"
            )
        return replace(
            self,
            length_mm=length_mm,
            frame_from_tip=_tip_at(length_mm, self.tip.rotation, self.frame),
        )

    def with_tip(self, frame_from_tip: Transform, sigma_mm: float) -> "ShownItem":
        """The same pointer with a calibrated tip.

        Raises `FrameError` for a tip between other frames, and `InputError` for one at the
        sensor's origin or with an uncertainty out of range.
        """
        if (frame_from_tip.target, frame_from_tip.source) != (self.frame, self.tip_frame):
            raise FrameError(
                f"{self.name}: the tip is {frame_from_tip.target}_from_{frame_from_tip.source}; "
                f"expected {self.frame}_from_{self.tip_frame}"
            )
        length_mm = _distance_mm(frame_from_tip)
        if length_mm < MIN_POINTER_MM:
            raise InputError(
                f"{self.name}: the tip is {length_mm:.3g} mm from the sensor's origin; expected "
                f"{MIN_POINTER_MM:g} mm or more"
            )
        if not 0.0 <= sigma_mm <= MAX_POINTER_SIGMA_MM:
            whose = f"{self.name}'" if self.name.endswith("s") else f"{self.name}'s"
            raise InputError(
                f"uncertainty of the {whose} tip: is {sigma_mm:.6g} mm; expected 0 to "
                f"{MAX_POINTER_SIGMA_MM:g} mm"
            )
        return replace(self, length_mm=length_mm, frame_from_tip=frame_from_tip, sigma_mm=sigma_mm)


def items_of(case: Case) -> tuple[ShownItem, ...]:
    """The items of ``case`` as declared. Raises `MarginGuardError` for a broken model."""
    models, items = case.item_meshes(), []
    for name, entry in case.manifest.items.items():
        if isinstance(entry, PointerEntry):
            edge, sigma_mm = entry.frame_from_tip, entry.sigma_mm
            length_mm = 0.0 if edge is None else _distance_mm(edge)
        else:
            length_mm, sigma_mm = entry.length_mm, 0.0
            edge = _tip_at(length_mm, _turned_from_z(np.array(entry.direction)), entry.frame)
        items.append(ShownItem(name, entry.frame, length_mm, edge, sigma_mm, models.get(name)))
    return tuple(items)


def _distance_mm(frame_from_tip: Transform) -> float:
    return float(np.linalg.norm(frame_from_tip.translation_mm))


def _tip_at(length_mm: float, rotation: FloatArray, frame: str) -> Transform:
    """The tip at ``length_mm`` along the z axis of ``rotation``."""
    return Transform(frame, f"{frame}_tip", rotation, length_mm * rotation[:, 2])


def _turned_from_z(direction: FloatArray) -> FloatArray:
    """A rotation (3, 3) of z to the unit vector ``direction`` (3,); the smallest one for z >= 0."""
    x, y, z = direction
    if z < 0.0:
        half_turn = np.diag([1.0, -1.0, -1.0])
        return np.asarray(half_turn @ _turned_from_z(half_turn @ direction))
    cross = np.array([[0.0, 0.0, x], [0.0, 0.0, y], [-x, -y, 0.0]])
    rotation: FloatArray = np.eye(3) + cross + cross @ cross / (1.0 + z)
    return rotation


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
