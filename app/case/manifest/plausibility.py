"""Values and reader of ``plausibility`` in ``case.yaml`` and ``live.yaml``."""

import math
from dataclasses import dataclass

from app.case.manifest.plausibility_keys import CUBOID, ENVELOPE, LENGTH, SPHERE
from app.files.document import Section
from app.files.keys import Variant
from app.geometry import InputError, MarginGuardError, Transform

Triple = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class MotionEntry:
    """Largest speeds and accelerations of a sensor."""

    speed_mm_s: float
    acceleration_mm_s2: float
    speed_rad_s: float
    acceleration_rad_s2: float


@dataclass(frozen=True, slots=True, eq=False)
class EnvelopeEntry:
    """``child`` stays within ``max_mm`` and ``max_rad`` of ``parent_from_child``.

    Without ``parent_from_child`` the mean pose of the first seconds is taken.
    """

    parent: str
    child: str
    max_mm: float
    max_rad: float
    parent_from_child: Transform | None = None


@dataclass(frozen=True, slots=True)
class DistanceEntry:
    """The origins of two frames are ``distance_mm`` apart, within ``tolerance_mm``."""

    parent: str
    child: str
    distance_mm: float
    tolerance_mm: float


@dataclass(frozen=True, slots=True)
class SphereEntry:
    """The tip stays within a sphere in ``frame``."""

    frame: str
    center_mm: Triple
    radius_mm: float


@dataclass(frozen=True, slots=True)
class BoxEntry:
    """The tip stays within a box along the axes of ``frame``."""

    frame: str
    min_mm: Triple
    max_mm: Triple


@dataclass(frozen=True, slots=True)
class ApproachEntry:
    """The tool's ``axis`` is within ``max_rad`` of ``direction`` in ``frame``; unit vectors."""

    frame: str
    direction: Triple
    axis: Triple
    max_rad: float


@dataclass(frozen=True, slots=True, eq=False)
class PlausibilityEntry:
    """The section ``plausibility``; all of it is optional."""

    motion: MotionEntry | None = None
    mean_drift_mm: float | None = None
    pairs: tuple[EnvelopeEntry | DistanceEntry, ...] = ()
    workspace: SphereEntry | BoxEntry | None = None
    approach: ApproachEntry | None = None

    @property
    def has_relations(self) -> bool:
        """True if at least one relation between measurements is configured."""
        return bool(self.pairs) or self.workspace is not None or self.approach is not None

    def ends(self, tool: str) -> tuple[tuple[str, str], ...]:
        """Pairs of frames whose relative poses the relations need; ``tool`` is the tool's frame."""
        regions = [region.frame for region in (self.workspace, self.approach) if region is not None]
        return (
            *((pair.parent, pair.child) for pair in self.pairs),
            *((frame, tool) for frame in regions),
        )


def read_plausibility(document: Section) -> PlausibilityEntry:
    """Read ``plausibility``; `InputError` for the first fault."""
    if "plausibility" not in document:
        return PlausibilityEntry()
    block = document.section("plausibility")
    return PlausibilityEntry(
        _motion(block.section("motion")) if "motion" in block else None,
        block.number("mean_drift_mm") if "mean_drift_mm" in block else None,
        tuple(map(_pair, block.sections("pairs"))) if "pairs" in block else (),
        _workspace(block.section("workspace")) if "workspace" in block else None,
        _approach(block.section("approach")) if "approach" in block else None,
    )


def _motion(block: Section) -> MotionEntry:
    return MotionEntry(
        block.number("max_speed_mm_s"),
        block.number("max_acceleration_mm_s2"),
        math.radians(block.number("max_speed_deg_s")),
        math.radians(block.number("max_acceleration_deg_s2")),
    )


def _pair(block: Section) -> EnvelopeEntry | DistanceEntry:
    parent, child = block.frame("parent"), block.frame("child")
    if parent == child:
        raise InputError(f"{block.place('child')} is {child!r}, the parent; expected another frame")
    if _variant(block, ENVELOPE, LENGTH) is LENGTH:
        return DistanceEntry(
            parent, child, block.number("distance_mm"), block.number("tolerance_mm")
        )
    pose = None
    if "pose" in block:
        entry = block.section("pose")
        try:
            pose = Transform.from_matrix(entry.numbers("matrix"), target=parent, source=child)
        except MarginGuardError as error:
            raise InputError(f"{entry.place('matrix')}: {error}") from error
    return EnvelopeEntry(
        parent, child, block.number("max_mm"), math.radians(block.number("max_deg")), pose
    )


def _workspace(block: Section) -> SphereEntry | BoxEntry:
    frame = block.frame("frame")
    if _variant(block, SPHERE, CUBOID) is SPHERE:
        return SphereEntry(frame, _triple(block, "center_mm"), block.number("radius_mm"))
    low, high = _triple(block, "min_mm"), _triple(block, "max_mm")
    for axis, least, greatest in zip("xyz", low, high, strict=True):
        if least >= greatest:
            raise InputError(
                f"{block.place('max_mm')} is {greatest:g} along {axis}; "
                f"expected more than min_mm ({least:g})"
            )
    return BoxEntry(frame, low, high)


def _approach(block: Section) -> ApproachEntry:
    return ApproachEntry(
        block.frame("frame"),
        _unit(block, "direction"),
        _unit(block, "axis"),
        math.radians(block.number("max_deg")),
    )


def _variant(block: Section, *variants: Variant) -> Variant:
    """Return the one variant of which a key is given; `InputError` for none and for several."""
    given = [
        variant
        for variant in variants
        if any(key in block for key in (*variant.required, *variant.optional))
    ]
    if len(given) != 1:
        choices = " or ".join(", ".join(variant.required) for variant in variants)
        raise InputError(
            f"{block.where} has keys of {' and '.join(each.name for each in given) or 'neither'}; "
            f"expected {choices}"
        )
    return given[0]


def _triple(block: Section, key: str) -> Triple:
    x, y, z = block.numbers(key)
    return x, y, z


def _unit(block: Section, key: str) -> Triple:
    x, y, z = _triple(block, key)
    length = math.hypot(x, y, z)
    if not (0.0 < length < math.inf):
        raise InputError(f"{block.place(key)} has length {length:g}; expected more than 0")
    return x / length, y / length, z / length
