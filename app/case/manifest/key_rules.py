"""Texts, patterns and readers that several keys share."""

import math
import re

from app.files.document import Section
from app.files.keys import Block, Numbers
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
