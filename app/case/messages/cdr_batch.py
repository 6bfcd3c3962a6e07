"""Samples of many pose and joint messages at once, straight from their CDR bytes.

Computes what `PoseValues.sample` and `JointValues.sample` compute, with the same operations in the
same order on arrays, so that the numbers agree to the last bit. What is not a good sample in a
known layout (a lost pose, unknown names, other bytes) is left out here: it is decoded by itself,
which also reports what is wrong with it.
"""

import math
from collections.abc import Callable, Sequence, Set
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.case.frame_streams import JointSample
from app.case.messages.cdr_layout import Column, Known, MessageColumns, columns_of
from app.case.messages.message_values import MM_PER_M
from app.geometry import (
    NS_PER_S,
    ROTATION_TOLERANCE,
    FloatArray,
    FrameError,
    Stamp,
    TrackedTransform,
    TrackingStatus,
    Transform,
    check_frame,
    rotations_of_quaternions,
)

Batch = Callable[[MessageColumns, str, Known], list[Any]]
"""Takes messages of one length, the `struct` format of their layout and the known names.

Returns for each message its sample, or None.
"""

_POSE_COLUMNS = 4
"""Seconds, nanoseconds, names, seven numbers of the pose."""


def tracked_samples(
    messages: MessageColumns, codes: str, known: Known
) -> list[TrackedTransform | None]:
    """Samples of ``marginguard_msgs/TrackedTransform``; None for all that are not OK."""
    *pose, status = columns_of(codes)
    is_ok = messages.numbers(status)[:, 0] == int(TrackingStatus.OK)
    return _poses(messages, pose, known, is_ok)


def tf_samples(
    messages: MessageColumns,
    codes: str,
    known: Known,
    *,
    unused: Set[tuple[str, str]] = frozenset(),
) -> list[tuple[TrackedTransform, ...] | None]:
    """Samples of ``tf2_msgs/TFMessage``; None for a message that holds one without a pose.

    Transforms of the edges ``unused`` are left out, good or not.
    """
    count, *columns = columns_of(codes)
    is_known = [number is not None for number in messages.known((count,), known)]
    all_good = np.ones(len(messages), np.bool_)
    samples: list[list[TrackedTransform | None]] = []
    for first in range(0, len(columns), _POSE_COLUMNS):
        pose = columns[first : first + _POSE_COLUMNS]
        if not set(messages.known((pose[2],), known)) <= unused:
            samples.append(_poses(messages, pose, known, all_good))
    if not samples:
        return [() if each else None for each in is_known]
    return [
        of_message if has_layout and None not in of_message else None
        for has_layout, of_message in zip(is_known, zip(*samples, strict=True), strict=True)
    ]


def joint_samples(
    messages: MessageColumns, codes: str, known: Known, *, offset_ns: int
) -> list[JointSample | None]:
    """Samples of ``sensor_msgs/JointState`` on the tracker's clock: robot + ``offset_ns``."""
    seconds, nanoseconds, names, numbers, velocity, effort = columns_of(codes)
    if numbers.begin == numbers.end:
        return [None] * len(messages)
    stamps = _stamps_ns(messages, seconds, nanoseconds)
    named = messages.known((names, velocity, effort), known)
    positions = messages.numbers(numbers)
    count = positions.shape[1]
    unique = {id(each): len(set(each)) == len(each) == count for each in named if each is not None}
    is_finite = np.isfinite(positions).all(axis=1).tolist()
    return [
        JointSample.unchecked(each, tuple(row), Stamp.of_ns(ns + offset_ns))
        if finite and each is not None and unique[id(each)]
        else None
        for each, row, ns, finite in zip(named, positions.tolist(), stamps, is_finite, strict=True)
    ]


def pose_arrays(
    translations_m: FloatArray, quaternions: FloatArray
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Translations (n, 3) in mm and rotations (n, 3, 3), read-only, and which of them are poses.

    Of the numbers in messages: translations (n, 3) in m, quaternions (n, 4) as xyzw. Those that are
    not finite or not rigid are no pose.
    """
    with np.errstate(all="ignore"):  # numbers that are not finite are left out
        translations_mm: FloatArray = MM_PER_M * translations_m
        norms = np.array(list(map(math.hypot, *quaternions.T.tolist())))
        rotations = rotations_of_quaternions(quaternions / norms[:, None])
        good = np.abs(norms - 1.0) <= ROTATION_TOLERANCE
        good &= np.isfinite(translations_mm).all(axis=1) & np.isfinite(quaternions).all(axis=1)
    translations_mm.setflags(write=False)
    rotations.setflags(write=False)
    return translations_mm, rotations, good


def _poses(
    messages: MessageColumns, columns: Sequence[Column], known: Known, is_ok: NDArray[np.bool_]
) -> list[TrackedTransform | None]:
    seconds, nanoseconds, names, numbers = columns
    values = messages.numbers(numbers)
    translations, rotations, good = pose_arrays(
        values[:, :3].astype(np.float64), values[:, 3:].astype(np.float64)
    )
    good &= is_ok
    named = [
        None if each is None or not is_good else each
        for each, is_good in zip(
            _frames(messages.known((names,), known)), good.tolist(), strict=True
        )
    ]
    return [
        None if each is None else _sample(each, rotation, translation_mm, ns)
        for each, rotation, translation_mm, ns in zip(
            named, rotations, translations, _stamps_ns(messages, seconds, nanoseconds), strict=True
        )
    ]


def _sample(
    frames: tuple[str, str], rotation: FloatArray, translation_mm: FloatArray, ns: int
) -> TrackedTransform:
    target, source = frames
    transform = Transform.of_read_only(target, source, rotation, translation_mm)
    return TrackedTransform.valid(transform, Stamp.of_ns(ns))


def _frames(named: list[tuple[str, str] | None]) -> list[tuple[str, str] | None]:
    """``named`` without names that cannot be frames."""
    usable: dict[tuple[str, str] | None, bool] = {None: False}
    for each in set(named) - {None}:
        usable[each] = _are_frames(each)
    return [each if usable[each] else None for each in named]


def _are_frames(names: tuple[str, str] | None) -> bool:
    try:
        for name in names or ():
            check_frame(name)
    except FrameError:
        return False
    return True


def _stamps_ns(messages: MessageColumns, seconds: Column, nanoseconds: Column) -> list[int]:
    whole = messages.numbers(seconds)[:, 0].astype(np.int64) * NS_PER_S
    stamps: list[int] = (whole + messages.numbers(nanoseconds)[:, 0]).tolist()
    return stamps
