"""Texts, patterns and readers that several keys share, and the margins of two documents."""

import math
import re
from dataclasses import dataclass
from typing import Annotated, Any

from app.files.declared import block_of
from app.files.document import Section
from app.files.keys import Block, Integer, Number, Numbers, Text
from app.geometry import InputError, Transform

RIGID = "a matrix is rigid: orthonormal without reflection, last row 0 0 0 1"
MATRIX = "16 numbers row by row, in mm"
TOPIC = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")
TOPIC_EXPECTED = "a topic that begins with '/', of letters, digits and underscores"
NO_DIRECTION = "a direction and an axis have a length above 0"

REFERENCE_FRAME = "reference"
YEAR_MS = 365 * 86_400_000

Triple = tuple[float, float, float]


def check_topic(topic: str, where: str) -> str:
    """Return ``topic``, given at ``where``; `InputError` unless it is a full ROS topic name."""
    if not TOPIC.fullmatch(topic):
        raise InputError(f"{where} is {topic!r}; expected {TOPIC_EXPECTED}")
    return topic


def topic_text(description: str, **options: Any) -> Text:
    """Return the key of a ROS topic; ``options`` are those of `Text`."""
    return Text(description, pattern=TOPIC, expected=TOPIC_EXPECTED, **options)


def pose_block(description: str, *, optional: bool = False) -> Block:
    """Return the block of a pose, which `read_pose` reads."""
    matrix = {"matrix": Numbers(MATRIX, 16)}
    return Block(description, matrix, optional=optional, rules=(RIGID,))


def read_pose(block: Section, key: str, *, target: str, source: str) -> Transform:
    """Read the pose ``key`` of ``block`` as ``target_from_source``; `InputError` if not rigid."""
    return block.section(key).matrix("matrix", target=target, source=source)


def read_direction(block: Section, key: str) -> Triple:
    """Read three numbers as a unit vector; `InputError` for a length of 0."""
    x, y, z = block.numbers(key)
    length = math.hypot(x, y, z)
    if not 0.0 < length < math.inf:
        raise InputError(f"{block.place(key)} has length {length:g}; expected more than 0")
    return x / length, y / length, z / length


SESSION_LIMITS = (
    "a session accepts stop_mm up to 100, warn_mm up to 200, k_tre up to 10, "
    "v_max_mm_s up to 1000, stale_after_ms up to 10000, release_samples up to 1000, "
    "release_band_mm up to 10, frozen_after_ms up to 60000"
)


@dataclass(frozen=True, slots=True)
class StructureMargins:
    """Distances of one structure."""

    stop_mm: Annotated[
        float,
        Number("distance at which the approach stops; must be less than warn_mm", minimum=0.0),
    ]
    warn_mm: Annotated[
        float,
        Number("distance below which the state is WARNING; must be more than stop_mm", minimum=0.0),
    ]

    def check(self, block: Section) -> None:
        """Raise `InputError` unless the warning comes before the stop."""
        if self.warn_mm <= self.stop_mm:
            raise InputError(
                f"{block.place('warn_mm')} is {self.warn_mm:g}; "
                f"expected more than stop_mm ({self.stop_mm:g})"
            )


@dataclass(frozen=True, slots=True)
class MarginEntry(StructureMargins):
    """The margins of the fixture, and the limits of freshness.

    A better state is entered only after ``release_samples`` samples that lie ``release_band_mm``
    beyond the boundary. A pose that is constant for ``frozen_after_ns`` is frozen.
    """

    k_tre: Annotated[
        float,
        Number("multiple of the registration's sigma that is added to both distances", minimum=0.0),
    ]
    v_max_mm_s: Annotated[
        float,
        Number(
            "maximum speed of approach; times the age of the data, added to both distances",
            minimum=0.0,
        ),
    ]
    stale_after_ns: Annotated[
        int, Number("age above which data are stale", above=0.0, maximum=YEAR_MS)
    ]
    release_samples: Annotated[
        int, Integer("number of consecutive better samples that end a worse state", 1, default=3)
    ]
    release_band_mm: Annotated[
        float,
        Number(
            "by how much the distance must exceed the threshold to count as better",
            default=0.5,
            minimum=0.0,
        ),
    ]
    frozen_after_ns: Annotated[
        int,
        Number(
            "time after which a pose that does not change counts as frozen",
            default=1000.0,
            above=0.0,
            maximum=YEAR_MS,
        ),
    ]


MARGINS = block_of(
    MarginEntry,
    "margins of the fixture, and the age at which data are stale",
    rules=("warn_mm is more than stop_mm", SESSION_LIMITS),
)
