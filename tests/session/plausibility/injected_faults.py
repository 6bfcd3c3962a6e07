"""Faults that are injected into tracker frames, each with its size over time."""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from app.case import TrackingFrame
from app.geometry import NS_PER_S, FloatArray, TrackedTransform, Transform

TOOL, TUMOR = "cautery", "needle"


@dataclass(frozen=True, slots=True)
class Fault:
    """A shift of the tool's pose by ``shift_mm(s since the fault)`` and a turn.

    Without both, the poses of tool and tumour are swapped. ``rate_mm_s`` is the speed of a creep, 0
    for faults that come at once.
    """

    name: str
    shift_mm: Callable[[float], float] | None = None
    turn_deg: float = 0.0
    rate_mm_s: float = 0.0

    def changed(self, pose: Transform, since_s: float, axis: FloatArray) -> Transform:
        """The wrong pose of the tool; ``axis`` is a unit vector."""
        turn = Rotation.from_rotvec(math.radians(self.turn_deg) * axis).as_matrix()
        shift = (self.shift_mm(since_s) if self.shift_mm else 0.0) * axis
        return Transform.unchecked(
            pose.target, pose.source, pose.rotation @ turn, pose.translation_mm + shift
        )


FAULTS = (
    *(Fault(f"jump of {mm:g} mm", lambda _, mm=mm: mm) for mm in (100.0, 10.0, 5.0, 4.0)),
    *(Fault(f"turn of {deg:g} degrees", turn_deg=deg) for deg in (180.0, 30.0)),
    Fault("tool and tumour swapped"),
    *(
        Fault(f"creep of {rate:g} mm/s", lambda s, rate=rate: rate * s, rate_mm_s=rate)
        for rate in (0.5, 2.0, 10.0)
    ),
)


def injected(
    frames: Iterable[TrackingFrame], fault: Fault, from_ns: int, random: np.random.Generator
) -> Iterator[TrackingFrame]:
    """Yield ``frames``, with ``fault`` from the stamp ``from_ns`` on in a random direction."""
    axis = random.normal(size=3)
    axis /= np.linalg.norm(axis)
    swap = {} if fault.shift_mm or fault.turn_deg else {TOOL: TUMOR, TUMOR: TOOL}
    for frame in frames:
        since_ns = frame.stamp.ns - from_ns
        if since_ns < 0:
            yield frame
            continue
        poses, true = [], {sample.source: sample.transform for sample in frame.poses}
        for sample in frame.poses:
            pose = true[swap.get(sample.source, sample.source)]
            if pose is not None and swap:
                pose = pose.renamed(source=sample.source)
            elif pose is not None and sample.source == TOOL:
                pose = fault.changed(pose, since_ns / NS_PER_S, axis)
            poses.append(sample if pose is None else TrackedTransform.valid(pose, sample.stamp))
        yield replace(frame, poses=tuple(poses))
