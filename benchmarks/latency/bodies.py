"""The moving bodies: their frames and poses."""

import math

from app.bridge.tf import Pose

ROOT = "world"
TURN_RAD = 0.01
"""Rotation of a body per frame."""


def body_frames(count: int) -> tuple[str, ...]:
    """Frame names of ``count`` bodies."""
    return tuple(f"body_{number:02d}" for number in range(count))


def body_pose(body: int, frame: int) -> Pose:
    """Pose of the body in `ROOT` at frame number ``frame``."""
    half = 0.5 * TURN_RAD * frame
    return (0.1 * frame, 10.0 * body, 5.0, 0.0, 0.0, math.sin(half), math.cos(half))
