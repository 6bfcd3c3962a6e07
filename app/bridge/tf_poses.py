"""Poses of tf as tuples of seven floats, which compose faster than numpy matrices.

A pose is ``(x, y, z, qx, qy, qz, qw)``: a translation in mm and a unit quaternion. ``a_from_b``
maps coordinates in b to coordinates in a, as `app.geometry.Transform` does.

``tf2_msgs/TFMessage`` is read and written as CDR bytes: deserialising 26 transforms takes over a
millisecond with rclpy's message objects and a small part of that here.
"""

import math
import struct
from collections.abc import Iterable
from typing import NamedTuple, TypeAlias

from app.bridge.messages import MM_PER_M
from app.bridge.ros_errors import TfInvalidError
from app.case.messages.decoder import tf_reader
from app.geometry import NS_PER_S

Pose: TypeAlias = tuple[float, float, float, float, float, float, float]

IDENTITY: Pose = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)

_NEARLY_PARALLEL = 1.0 - 1e-9
"""Cosine above which the sine is too small to divide by; linear interpolation is exact there."""

# Deserialising 26 transforms takes over a millisecond with rclpy and a small part of that here.

_COUNT = struct.Struct("<I")
_HEAD = struct.Struct("<iII")
_POSE = struct.Struct("<7d")


def compose(a_from_b: Pose, b_from_c: Pose) -> Pose:
    """``a_from_c``."""
    ax, ay, az, x, y, z, w = a_from_b
    bx, by, bz, p, q, r, s = b_from_c
    # Rotation by a unit quaternion (u, w): v' = v + 2 u x (u x v + w v).
    tx, ty, tz = 2.0 * (y * bz - z * by), 2.0 * (z * bx - x * bz), 2.0 * (x * by - y * bx)
    return (
        ax + bx + w * tx + y * tz - z * ty,
        ay + by + w * ty + z * tx - x * tz,
        az + bz + w * tz + x * ty - y * tx,
        w * p + x * s + y * r - z * q,
        w * q - x * r + y * s + z * p,
        w * r + x * q - y * p + z * s,
        w * s - x * p - y * q - z * r,
    )


def inverse(a_from_b: Pose) -> Pose:
    """``b_from_a``."""
    px, py, pz, x, y, z, w = a_from_b
    x, y, z = -x, -y, -z
    tx, ty, tz = 2.0 * (y * pz - z * py), 2.0 * (z * px - x * pz), 2.0 * (x * py - y * px)
    return (
        -(px + w * tx + y * tz - z * ty),
        -(py + w * ty + z * tx - x * tz),
        -(pz + w * tz + x * ty - y * tx),
        x,
        y,
        z,
        w,
    )


def interpolate(first: Pose, second: Pose, fraction: float) -> Pose:
    """Interpolate from ``first`` (``fraction`` 0) to ``second`` (1).

    Linear interpolation of the translation and spherical linear interpolation of the quaternion
    along the shorter arc (Shoemake 1985), as in tf2.
    """
    ax, ay, az, ap, aq, ar, as_ = first
    bx, by, bz, bp, bq, br, bs = second
    cosine = ap * bp + aq * bq + ar * br + as_ * bs
    sign = 1.0
    if cosine < 0.0:
        # A quaternion and its negative are the same rotation: use the nearer one.
        sign, cosine = -1.0, -cosine
    if cosine > _NEARLY_PARALLEL:
        u, v = 1.0 - fraction, sign * fraction
    else:
        angle = math.acos(cosine)
        sine = math.sqrt(1.0 - cosine * cosine)
        u = math.sin((1.0 - fraction) * angle) / sine
        v = sign * math.sin(fraction * angle) / sine
    p, q, r, s = u * ap + v * bp, u * aq + v * bq, u * ar + v * br, u * as_ + v * bs
    scale = 1.0 / math.sqrt(p * p + q * q + r * r + s * s)
    return (
        ax + fraction * (bx - ax),
        ay + fraction * (by - ay),
        az + fraction * (bz - az),
        scale * p,
        scale * q,
        scale * r,
        scale * s,
    )


class TfSample(NamedTuple):
    """``parent_from_child`` at ``stamp_ns``; the pose is in mm and not validated."""

    parent: str
    child: str
    stamp_ns: int
    pose: Pose


class TfMessageReader:
    """Reads serialised messages of one topic. Not thread-safe."""

    def __init__(self) -> None:
        self._read = tf_reader()

    def __call__(self, message: bytes) -> list[TfSample]:
        """Deserialise a message, converting m to mm; raises `TfInvalidError` for invalid bytes."""
        try:
            poses = self._read(message)
        except ValueError as error:
            raise TfInvalidError(
                f"a tf message of {len(message)} bytes is invalid: {error}"
            ) from error
        return [
            TfSample(parent, child, ns, (MM_PER_M * x, MM_PER_M * y, MM_PER_M * z, *quaternion))
            for parent, child, ns, (x, y, z), quaternion, _ in poses
        ]


def write_tf_message(samples: Iterable[TfSample]) -> bytes:
    """Serialise ``samples`` to a message, converting mm to m, for a raw publish."""
    body = bytearray(4)
    count = 0
    for parent, child, stamp_ns, pose in samples:
        count += 1
        seconds, nanoseconds = divmod(stamp_ns, NS_PER_S)
        name = parent.encode() + b"\0"
        body += bytes(-len(body) % 4) + _HEAD.pack(seconds, nanoseconds, len(name)) + name
        name = child.encode() + b"\0"
        body += bytes(-len(body) % 4) + _COUNT.pack(len(name)) + name
        x, y, z, p, q, r, s = pose
        x, y, z = x / MM_PER_M, y / MM_PER_M, z / MM_PER_M
        body += bytes(-len(body) % 8) + _POSE.pack(x, y, z, p, q, r, s)
    _COUNT.pack_into(body, 0, count)
    return b"\x00\x01\x00\x00" + bytes(body)
