"""Faults that are injected into tracker frames, each with its size over time."""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from app.case import TrackingFrame
from app.geometry import NS_PER_S, FloatArray, TrackedTransform, Transform

TOOL, TUMOR = "cautery", "needle"

Change = Callable[[Transform, float, FloatArray], Transform]
"""Pose, time in s since the fault, and a random unit vector -> wrong pose."""


@dataclass(frozen=True, slots=True)
class Fault:
    """``change`` makes the tool's pose wrong; None swaps the poses of tool and tumour.

    ``rate_mm_s`` is the speed of a creep, 0 for faults that come at once.
    """

    name: str
    change: Change | None
    rate_mm_s: float = 0.0


def _jump(size_mm: float) -> Change:
    return lambda pose, _, axis: _moved(pose, size_mm * axis)


def _creep(rate_mm_s: float) -> Change:
    return lambda pose, since_s, axis: _moved(pose, rate_mm_s * since_s * axis)


def _turn(angle_deg: float) -> Change:
    def turned(pose: Transform, _: float, axis: FloatArray) -> Transform:
        turn = Rotation.from_rotvec(math.radians(angle_deg) * axis).as_matrix()
        return Transform.unchecked(
            pose.target, pose.source, pose.rotation @ turn, pose.translation_mm.copy()
        )

    return turned


def _moved(pose: Transform, shift_mm: FloatArray) -> Transform:
    return Transform.unchecked(
        pose.target, pose.source, pose.rotation.copy(), pose.translation_mm + shift_mm
    )


JUMPS_MM, TURNS_DEG, CREEPS_MM_S = (100.0, 10.0, 5.0), (180.0, 30.0), (0.5, 2.0, 10.0)

FAULTS = (
    *(Fault(f"jump of {size:g} mm", _jump(size)) for size in JUMPS_MM),
    *(Fault(f"turn of {angle:g} degrees", _turn(angle)) for angle in TURNS_DEG),
    Fault("tool and tumour swapped", None),
    *(Fault(f"creep of {rate:g} mm/s", _creep(rate), rate) for rate in CREEPS_MM_S),
)


def injected(
    frames: Iterable[TrackingFrame], fault: Fault, from_ns: int, random: np.random.Generator
) -> Iterator[TrackingFrame]:
    """Yield ``frames``, with ``fault`` from the stamp ``from_ns`` on in a random direction."""
    axis = random.normal(size=3)
    axis /= np.linalg.norm(axis)
    for frame in frames:
        since_ns = frame.stamp.ns - from_ns
        if since_ns < 0:
            yield frame
        else:
            yield replace(frame, poses=_faulty(frame.poses, fault, since_ns / NS_PER_S, axis))


def _faulty(
    poses: tuple[TrackedTransform, ...], fault: Fault, since_s: float, axis: FloatArray
) -> tuple[TrackedTransform, ...]:
    swap = {TOOL: TUMOR, TUMOR: TOOL}
    by_name = {sample.source: sample for sample in poses}
    changed = []
    for sample in poses:
        pose = sample.transform
        if pose is not None and fault.change is None:
            other = by_name[swap.get(sample.source, sample.source)].transform
            pose = None if other is None else other.renamed(source=sample.source)
        elif pose is not None and fault.change is not None and sample.source == TOOL:
            pose = fault.change(pose, since_s, axis)
        changed.append(sample if pose is None else TrackedTransform.valid(pose, sample.stamp))
    return tuple(changed)
