"""The bodies that move: how they are called and where they are."""

import math

from app.bridge.tf import Pose

ROOT = "world"
TURN_RAD = 0.01
"""What a body turns by from one frame to the next."""


def body_frames(count: int) -> tuple[str, ...]:
    """The frames of ``count`` bodies."""
    return tuple(f"body_{number:02d}" for number in range(count))


def body_pose(body: int, frame: int) -> Pose:
    """Where the ``frame``-th frame has that body in `ROOT`."""
    half = 0.5 * TURN_RAD * frame
    return (0.1 * frame, 10.0 * body, 5.0, 0.0, 0.0, math.sin(half), math.cos(half))
