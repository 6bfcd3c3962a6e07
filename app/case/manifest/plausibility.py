"""``plausibility``: what a measured pose can be, the same in ``case.yaml`` and in ``live.yaml``."""

from dataclasses import dataclass
from typing import Annotated

from app.case.manifest.key_rules import NO_DIRECTION, Triple, pose_block, read_direction, read_pose
from app.files.declared import By, block_of, read_as
from app.files.document import Section
from app.files.keys import Block, Frame, Key, ListOf, Number, Numbers, Variant
from app.geometry import InputError, Transform

TWO_FRAMES = "parent and child are two frames"
BOX = "every value of max_mm is more than that of min_mm"

ENVELOPE = Variant("envelope", ("max_mm", "max_deg"), ("pose",))
LENGTH = Variant("distance", ("distance_mm", "tolerance_mm"))
SPHERE = Variant("sphere", ("center_mm", "radius_mm"))
CUBOID = Variant("box", ("min_mm", "max_mm"))


@dataclass(frozen=True, slots=True)
class MotionEntry:
    """Largest speeds and accelerations of a sensor."""

    speed_mm_s: Annotated[float, "max_speed_mm_s", Number("speed", default=2_000.0, above=0.0)]
    acceleration_mm_s2: Annotated[
        float, "max_acceleration_mm_s2", Number("acceleration", default=16_000.0, above=0.0)
    ]
    speed_rad_s: Annotated[
        float, "max_speed_deg_s", Number("angular speed", default=1_200.0, above=0.0)
    ]
    acceleration_rad_s2: Annotated[
        float,
        "max_acceleration_deg_s2",
        Number("angular acceleration", default=15_000.0, above=0.0),
    ]


@dataclass(frozen=True, slots=True)
class _Pair:
    parent: Annotated[str, Frame("one of the frames")]
    child: Annotated[str, Frame("the other one")]

    def check(self, block: Section) -> None:
        """Raise `InputError` for one frame."""
        if self.parent == self.child:
            raise InputError(
                f"{block.place('child')} is {self.child!r}, the parent; expected another frame"
            )


def _child_pose(pair: Section) -> Transform | None:
    if "pose" not in pair:
        return None
    return read_pose(pair, "pose", target=pair.frame("parent"), source=pair.frame("child"))


@dataclass(frozen=True, slots=True, eq=False)
class EnvelopeEntry(_Pair):
    """``child`` stays within ``max_mm`` and ``max_rad`` of ``parent_from_child``.

    Without ``parent_from_child`` the mean pose of the first seconds is taken.
    """

    max_mm: Annotated[float, Number("largest displacement by breath", optional=True, above=0.0)]
    max_rad: Annotated[
        float, Number("largest rotation of the child", optional=True, above=0.0, maximum=180.0)
    ]
    parent_from_child: Annotated[
        Transform | None,
        "pose",
        pose_block(
            "pose of the child in the parent; by default the mean of the first 5 s", optional=True
        ),
        By(_child_pose),
    ] = None


@dataclass(frozen=True, slots=True)
class DistanceEntry(_Pair):
    """The origins of two frames are ``distance_mm`` apart, within ``tolerance_mm``."""

    distance_mm: Annotated[float, Number("distance of the two origins", optional=True, minimum=0.0)]
    tolerance_mm: Annotated[float, Number("largest difference from it", optional=True, above=0.0)]


@dataclass(frozen=True, slots=True)
class SphereEntry:
    """The tip stays within a sphere in ``frame``."""

    frame: Annotated[str, Frame("frame of the region")]
    center_mm: Annotated[Triple, Numbers("centre of a sphere", 3, optional=True)]
    radius_mm: Annotated[float, Number("its radius", optional=True, above=0.0)]


@dataclass(frozen=True, slots=True)
class BoxEntry:
    """The tip stays within a box along the axes of ``frame``."""

    frame: Annotated[str, Frame("frame of the region")]
    min_mm: Annotated[Triple, Numbers("smallest x, y, z of a box", 3, optional=True)]
    max_mm: Annotated[Triple, Numbers("largest x, y, z of a box", 3, optional=True)]

    def check(self, block: Section) -> None:
        """Raise `InputError` for a box without volume."""
        for axis, least, greatest in zip("xyz", self.min_mm, self.max_mm, strict=True):
            if least >= greatest:
                raise InputError(
                    f"{block.place('max_mm')} is {greatest:g} along {axis}; "
                    f"expected more than min_mm ({least:g})"
                )


@dataclass(frozen=True, slots=True)
class ApproachEntry:
    """The tool's ``axis`` is within ``max_rad`` of ``direction`` in ``frame``; unit vectors."""

    frame: Annotated[str, Frame("tracked frame of the direction, or the base of the robot")]
    direction: Annotated[
        Triple,
        Numbers("axis of the cone in that frame", 3),
        By(lambda block: read_direction(block, "direction")),
    ]
    axis: Annotated[
        Triple,
        Numbers("axis of the tool, in the frame of its tip", 3),
        By(lambda block: read_direction(block, "axis")),
    ]
    max_rad: Annotated[float, Number("largest angle between them", above=0.0, maximum=180.0)]


def _one_of(
    description: str, entries: dict[type, Variant], rules: tuple[str, ...], *, optional: bool
) -> Block:
    """The keys of all ``entries``; the one is read of which a key beyond the common ones is given.

    Raises `InputError` in reading for keys of none and of several.
    """

    def read(block: Section) -> object:
        given = {
            entry: variant
            for entry, variant in entries.items()
            if any(key in block for key in (*variant.required, *variant.optional))
        }
        if len(given) != 1:
            choices = " or ".join(", ".join(each.required) for each in entries.values())
            found = " and ".join(each.name for each in given.values()) or "neither"
            raise InputError(f"{block.where} has keys of {found}; expected {choices}")
        entry, variant = given.popitem()
        block.require(variant.required)
        return read_as(entry, block)

    keys: dict[str, Key] = {}
    for entry in entries:
        keys |= block_of(entry, "").keys
    variants = tuple(entries.values())
    return Block(description, keys, variants, rules=rules, optional=optional, read=read)


@dataclass(frozen=True, slots=True, eq=False)
class PlausibilityEntry:
    """The section ``plausibility``; all of it is optional."""

    motion: Annotated[
        MotionEntry | None,
        block_of(
            MotionEntry,
            "largest motion of a sensor on a held tool or on the patient; beyond it a pose is not "
            "used",
            optional=True,
        ),
    ] = None
    mean_drift_mm: Annotated[
        float | None,
        Number(
            "largest mean difference, over about 0.25 s, between the tool's position by tracker "
            "and by robot, and its largest sudden change; default: half of "
            "registration.max_drift_mm",
            optional=True,
            above=0.0,
        ),
    ] = None
    pairs: Annotated[
        tuple[EnvelopeEntry | DistanceEntry, ...],
        ListOf(
            "relations of two tracked frames",
            _one_of(
                "two tracked frames whose relative pose hardly changes",
                {EnvelopeEntry: ENVELOPE, DistanceEntry: LENGTH},
                (TWO_FRAMES,),
                optional=False,
            ),
            optional=True,
        ),
    ] = ()
    workspace: Annotated[
        SphereEntry | BoxEntry | None,
        _one_of(
            "region that the tip of the tool never leaves, in a tracked frame or the base of the "
            "robot",
            {SphereEntry: SPHERE, BoxEntry: CUBOID},
            (BOX,),
            optional=True,
        ),
    ] = None
    approach: Annotated[
        ApproachEntry | None,
        block_of(
            ApproachEntry,
            "cone of directions of the tool: about gravity, or about the planned approach",
            optional=True,
            rules=(NO_DIRECTION,),
        ),
    ] = None

    def ends(self, tool: str) -> tuple[tuple[str, str], ...]:
        """Pairs of frames whose relative poses the relations need; ``tool`` is the tool's frame."""
        regions = [region.frame for region in (self.workspace, self.approach) if region is not None]
        return (
            *((pair.parent, pair.child) for pair in self.pairs),
            *((frame, tool) for frame in regions),
        )


PLAUSIBILITY = block_of(
    PlausibilityEntry, "limits and relations by which a wrong pose is found", optional=True
)
