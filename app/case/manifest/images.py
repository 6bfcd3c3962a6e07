"""Tracked ultrasound images and activation, in ``case.yaml`` and in ``live.yaml``."""

from dataclasses import dataclass
from typing import Annotated

from app.case.manifest.display_items import ENERGY_DEVICE
from app.case.manifest.key_rules import YEAR_MS, topic_text
from app.files.declared import block_of, value_as
from app.files.document import Section
from app.files.keys import Block, Choice, Frame, ListOf, Number, Numbers, Text, Variant
from app.geometry import InputError

ORIENTATIONS = ("MF", "MN", "UF", "UN", "FM", "NM", "FU", "NU")
"""Directions of columns and rows: M marked, U unmarked side of the probe, F far from it, N near."""

NOT_BOTH = "images has path or topic, not both"
FROM_IGTL = "images without a topic need source.igtl, and only they have a device"
LISTED_DEPTH = "the depths of images.calibrations differ, and images.depth_mm is one of them"
MAX_DEPTH_MM = 500.0


@dataclass(frozen=True, slots=True)
class ImageCalibrationEntry:
    """``ImageToProbe`` by a file as written, or by 16 numbers. ``depth_mm`` None: any depth."""

    depth_mm: Annotated[float | None, Number("imaging depth", above=0.0, maximum=MAX_DEPTH_MM)]
    path: Annotated[
        str | None,
        Text("ImageToProbe: a PLUS configuration (.xml) or a transform file", optional=True),
    ]
    matrix: Annotated[
        tuple[float, ...] | None,
        Numbers("ImageToProbe, 4 x 4, row by row: pixels to mm", 16, optional=True),
    ]

    def check(self, block: Section) -> None:
        """Raise `InputError` unless one of file and matrix is given."""
        if (self.path is None) is (self.matrix is None):
            given = "neither" if self.path is None else "both"
            raise InputError(f"{block.where} has {given} of path and matrix; expected one of them")


@dataclass(frozen=True, slots=True)
class ImagesEntry:
    """Tracked ultrasound: path as written of the sequence, and the calibrations of the probe.

    ``calibrations``: one without a depth, or one for each depth; ``depth_mm`` is then the one at
    the start. ``path`` None: the recording. ``topic``: that of the images in a bag or in a live
    session, None for a sequence and for OpenIGTLink. ``orientation`` is that of images that do not
    name it. ``stale_after_ns``: None for that of the margins.
    """

    path: str | None
    probe: str
    calibrations: tuple[ImageCalibrationEntry, ...]
    orientation: str | None
    stale_after_ns: int | None
    topic: str | None = None
    depth_mm: float | None = None


_PLACE = {
    "probe": Frame("the tracked frame of the probe"),
    "calibration": Text(
        "ImageToProbe: a PLUS configuration (.xml) or a transform file", optional=True
    ),
    "calibrations": ListOf(
        "one calibration for each imaging depth that is used, instead of calibration",
        block_of(
            ImageCalibrationEntry,
            "ImageToProbe at one depth",
            variants=(Variant("file", ("path",)), Variant("matrix", ("matrix",))),
        ),
        optional=True,
        if_empty="give calibration for a probe with one depth",
    ),
    "depth_mm": Number(
        "the depth of calibrations that is used at the start",
        optional=True,
        above=0.0,
        maximum=MAX_DEPTH_MM,
    ),
}
ONE_DEPTH, SEVERAL_DEPTHS = ("calibration",), ("calibrations", "depth_mm")


def _variants(*optional: str) -> tuple[Variant, ...]:
    """By one calibration or by several; ``optional`` are keys of both."""
    return (
        Variant("one depth", ONE_DEPTH, optional=optional),
        Variant("several depths", SEVERAL_DEPTHS, optional=optional),
    )


_AGE = {
    "stale_after_ms": Number(
        "maximum age of an image that is shown; by default that of margins",
        optional=True,
        above=0.0,
        maximum=YEAR_MS,
    ),
}

IMAGES = Block(
    "tracked ultrasound images",
    {
        "path": Text(
            "sequence with images (.igs.mha, .igs.mhd, .igs.nrrd, .igs.nhdr) and the poses of the "
            "probe, on the clock of the tracker; by default the recording",
            optional=True,
        ),
        "topic": topic_text(
            "topic of sensor_msgs/Image in the recording, which is a bag in MCAP; instead of path",
            optional=True,
        ),
        **_PLACE,
        "orientation": Choice(
            "orientation of images whose header names none; of a topic by default MF",
            ORIENTATIONS,
            optional=True,
        ),
        **_AGE,
    },
    optional=True,
    variants=_variants("path", "topic", "orientation", "stale_after_ms"),
    rules=(NOT_BOTH, LISTED_DEPTH),
)

LIVE_IMAGES = Block(
    "tracked ultrasound images on the clock of the tracker, shown on the page",
    {
        "topic": topic_text(
            "topic of sensor_msgs/Image (mono8, mono16, rgb8); without it the images come over the "
            "OpenIGTLink connection of source.igtl",
            optional=True,
        ),
        "device": Text(
            "device name of the OpenIGTLink images; by default that of the first one",
            optional=True,
        ),
        **_PLACE,
        "orientation": Choice("orientation in which they are sent", ORIENTATIONS, default="MF"),
        **_AGE,
    },
    optional=True,
    variants=_variants("topic", "device", "stale_after_ms"),
    rules=(FROM_IGTL, LISTED_DEPTH),
)

_SAME_MM = 0.01
"""Depths that differ by less are one."""


def read_images(document: Section) -> ImagesEntry | None:
    """Read ``images``; None for a case without images."""
    if "images" not in document:
        return None
    block = document.section("images")
    if "path" in block and "topic" in block:
        raise InputError(f"{block.where} has path and topic; expected one of them or none")
    calibrations, depth_mm = _calibrations(block)
    return ImagesEntry(
        block.text("path") if "path" in block else None,
        block.frame("probe"),
        calibrations,
        block.value("orientation"),
        value_as(block, "stale_after_ns"),
        block.value("topic"),
        depth_mm,
    )


def _calibrations(block: Section) -> tuple[tuple[ImageCalibrationEntry, ...], float | None]:
    """The calibrations, and the depth at the start; None for the one of a probe with one depth."""
    if "calibrations" not in block:
        if "depth_mm" in block:
            raise InputError(f"{block.place('depth_mm')} is given; expected calibrations with it")
        return (ImageCalibrationEntry(None, block.text("calibration"), None),), None
    if "calibration" in block:
        raise InputError(f"{block.where} has calibration and calibrations; expected one of them")
    entries: tuple[ImageCalibrationEntry, ...] = block.value("calibrations")
    depths_mm = [each.depth_mm or 0.0 for each in entries]
    for index, depth_mm in enumerate(depths_mm):
        if any(abs(depth_mm - other) < _SAME_MM for other in depths_mm[:index]):
            raise InputError(
                f"{block.place('calibrations')}: depth_mm {depth_mm:g} is listed twice; expected "
                "each depth once"
            )
    start_mm = block.number("depth_mm")
    listed = ", ".join(f"{each:g}" for each in depths_mm)
    found = [each for each in depths_mm if abs(each - start_mm) < _SAME_MM]
    if not found:
        raise InputError(
            f"{block.place('depth_mm')} is {start_mm:g}; expected one of calibrations: {listed}"
        )
    return entries, found[0]


@dataclass(frozen=True, slots=True)
class ActivationEntry:
    """Source of the activation: a ROS ``topic``, or an OpenIGTLink ``device``.

    Older than ``stale_after_ns`` it is unknown.
    """

    topic: str | None
    device: str | None
    stale_after_ns: int


ONE_SOURCE = f"{ENERGY_DEVICE.name} has topic or device, and device needs source.igtl"

_DAY_MS = 86_400_000
_ACTIVATION_AGE = Number(
    "age after which what was said is unknown; longer than the period of the messages",
    default=1000.0,
    above=0.0,
    maximum=_DAY_MS,
)

ACTIVATION = Block(
    f"whether {ENERGY_DEVICE.burns}, shown and recorded only",
    {
        "topic": topic_text(
            f"topic of std_msgs/Bool in the recording, a bag: true while {ENERGY_DEVICE.burns}"
        ),
        "stale_after_ms": _ACTIVATION_AGE,
    },
    optional=True,
)

LIVE_ACTIVATION = Block(
    f"whether {ENERGY_DEVICE.burns}, shown and recorded only; it changes no margin",
    {
        "topic": topic_text(
            f"topic of std_msgs/Bool: true while {ENERGY_DEVICE.burns}", optional=True
        ),
        "device": Text(
            "device name of OpenIGTLink STRING messages (on, off) of source.igtl, instead of topic",
            optional=True,
        ),
        "stale_after_ms": _ACTIVATION_AGE,
    },
    optional=True,
    rules=(ONE_SOURCE,),
)


def read_activation(document: Section) -> ActivationEntry | None:
    """Read the source of the activation; None for a session without it."""
    if ENERGY_DEVICE.name not in document:
        return None
    block = document.section(ENERGY_DEVICE.name)
    topic = block.value("topic")
    device = block.text("device") if "device" in block else None
    if (topic is None) == (device is None):
        found = "neither topic nor device" if topic is None else "topic and device"
        raise InputError(f"{block.where} has {found}; expected one of them")
    return ActivationEntry(topic, device, value_as(block, "stale_after_ns"))
