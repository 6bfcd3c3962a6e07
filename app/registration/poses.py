"""Lists of poses as they come in: the good samples, all between the same frames, spread enough."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from app.geometry import FloatArray, FrameError, TrackedTransform, TrackingStatus, Transform
from app.registration.errors import (
    DegenerateMotionError,
    NoValidSamplesError,
    ShapeError,
    TooFewError,
)

MAX_COMPARED = 150
"""How many poses, spread evenly over a list, are compared pair by pair."""

SAME_POSE_RAD = 1e-6
SAME_POSE_MM = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class PoseStack:
    """Poses ``target_from_source`` as arrays: rotations (n, 3, 3), translations (n, 3) in mm."""

    target: str
    source: str
    rotations: FloatArray
    translations_mm: FloatArray

    @classmethod
    def of(cls, poses: Sequence[Transform], what: str, *, least: int) -> "PoseStack":
        """At least ``least`` poses between the same two frames, not all of them one pose."""
        if len(poses) < least:
            raise TooFewError(f"{len(poses)} poses for {what}: at least {least} wanted")
        names = Counter((pose.target, pose.source) for pose in poses)
        if len(names) > 1:
            given = ", ".join(f"{target}_from_{source}" for target, source in names)
            raise FrameError(f"poses for {what} are between different frames: {given}")
        rotations = np.stack([pose.rotation for pose in poses])
        translations = np.stack([pose.translation_mm for pose in poses])
        turn = np.abs(rotations - rotations[0]).max()
        shift = np.abs(translations - translations[0]).max()
        if turn < SAME_POSE_RAD and shift < SAME_POSE_MM:
            raise DegenerateMotionError(
                f"the {len(poses)} poses for {what} are one pose repeated: "
                f"they differ by {shift:.3g} mm and {turn:.3g} rad at most"
            )
        return cls(poses[0].target, poses[0].source, rotations, translations)

    def of_poses(self, kept: NDArray[np.bool_]) -> "PoseStack":
        """Some of the poses, by a mask (n,)."""
        return PoseStack(self.target, self.source, self.rotations[kept], self.translations_mm[kept])

    def relative_turns(self) -> FloatArray:
        """Rotation vectors in rad, (m, 3), in the source frame, between pairs of the poses."""
        kept = np.unique(np.linspace(0, len(self.rotations) - 1, MAX_COMPARED).round().astype(int))
        first, second = np.triu_indices(len(kept), k=1)
        rotations = self.rotations[kept]
        turns = np.swapaxes(rotations[first], 1, 2) @ rotations[second]
        return np.asarray(Rotation.from_matrix(turns).as_rotvec())


def usable_poses(samples: Sequence[TrackedTransform]) -> tuple[Transform, ...]:
    """The transforms of the samples that are OK; `NoValidSamplesError` when none is."""
    poses = tuple(sample.transform for sample in samples if sample.transform is not None)
    if not poses:
        counts = Counter(sample.status for sample in samples)
        found = ", ".join(
            f"{count} {TrackingStatus(status).name}" for status, count in counts.items()
        )
        raise NoValidSamplesError(f"0 of {len(samples)} samples are OK ({found or 'none given'})")
    return poses


def select_poses(
    poses: Sequence[Transform],
    *,
    min_distance_mm: float = 3.0,
    min_angle_rad: float = np.radians(5.0),
) -> tuple[int, ...]:
    """Indices of poses that moved and turned by this much since the last one kept.

    Neighbouring samples of a slow hand share their error, so that a thousand of them say no more
    than a few. The first pose is kept.
    """
    if not poses:
        raise TooFewError("0 poses to select from: at least 1 wanted")
    kept = [0]
    for index, pose in enumerate(poses[1:], start=1):
        last = poses[kept[-1]]
        if pose.distance_mm_to(last) >= min_distance_mm and pose.angle_to(last) >= min_angle_rad:
            kept.append(index)
    return tuple(kept)


@dataclass(frozen=True, slots=True)
class PoseNoise:
    """Standard deviation of a measured pose, for each axis: of its rotation and its position.

    A figure that is a 3-D root mean square is this times the square root of 3.
    """

    rotation_rad: float
    translation_mm: float

    def __post_init__(self) -> None:
        for name in ("rotation_rad", "translation_mm"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ShapeError(f"{name} of the pose noise is {value}: above 0 wanted")

    @classmethod
    def from_rms(cls, *, rotation_deg: float, translation_mm: float) -> "PoseNoise":
        """From 3-D root mean squares, as tracker makers print them."""
        return cls(math.radians(rotation_deg) / math.sqrt(3.0), translation_mm / math.sqrt(3.0))

    @property
    def sigmas(self) -> FloatArray:
        """(6,): three times rad, three times mm."""
        return np.repeat([self.rotation_rad, self.translation_mm], 3)
