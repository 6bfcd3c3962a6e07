"""The keys of ``images`` in ``case.yaml`` and in ``live.yaml``."""

from app.case.manifest.key_rules import TOPIC, TOPIC_EXPECTED
from app.files.keys import Block, Choice, Frame, ListOf, Number, Numbers, Text, Variant

ORIENTATIONS = ("MF", "MN", "UF", "UN", "FM", "NM", "FU", "NU")
"""Directions of columns and rows: M marked, U unmarked side of the probe, F far from it, N near."""

NOT_BOTH = "images has path or topic, not both"
FROM_IGTL = "images without a topic need source.igtl, and only they have a device"
LISTED_DEPTH = "the depths of images.calibrations differ, and images.depth_mm is one of them"
MAX_DEPTH_MM = 500.0

_YEAR_MS = 365 * 86_400_000

_PLACE = {
    "probe": Frame("the tracked frame of the probe"),
    "calibration": Text(
        "ImageToProbe: a PLUS configuration (.xml) or a transform file", optional=True
    ),
    "calibrations": ListOf(
        "one calibration for each imaging depth that is used, instead of calibration",
        Block(
            "ImageToProbe at one depth",
            {
                "depth_mm": Number("imaging depth", above=0.0, maximum=MAX_DEPTH_MM),
                "path": Text(
                    "ImageToProbe: a PLUS configuration (.xml) or a transform file", optional=True
                ),
                "matrix": Numbers(
                    "ImageToProbe, 4 x 4, row by row: pixels to mm", 16, optional=True
                ),
            },
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
        maximum=_YEAR_MS,
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
        "topic": Text(
            "topic of sensor_msgs/Image in the recording, which is a bag in MCAP; instead of path",
            optional=True,
            pattern=TOPIC,
            expected=TOPIC_EXPECTED,
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
        "topic": Text(
            "topic of sensor_msgs/Image (mono8, mono16, rgb8); without it the images come over the "
            "OpenIGTLink connection of source.igtl",
            optional=True,
            pattern=TOPIC,
            expected=TOPIC_EXPECTED,
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
