"""Lists of poses: selection and validation."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # loads `scipy.spatial` lazily, which takes 0.2 s
from numpy.typing import NDArray

from app.geometry import FloatArray, FrameError, TrackedTransform, TrackingStatus, Transform
from app.registration.errors import (
    DegenerateMotionError,
    NoValidSamplesError,
    ShapeError,
    TooFewError,
)

MAX_COMPARED = 150
"""Maximum number of poses, evenly spaced in a list, that are compared in pairs."""

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
    def from_poses(cls, poses: Sequence[Transform], what: str, *, min_count: int) -> "PoseStack":
        """Stack at least ``min_count`` poses between the same two frames.

        Raises `TooFewError`, `FrameError`, or `DegenerateMotionError` if all are the same pose.
        """
        if len(poses) < min_count:
            raise TooFewError(f"{len(poses)} poses for {what}; expected at least {min_count}")
        names = Counter((pose.target, pose.source) for pose in poses)
        if len(names) > 1:
            given = ", ".join(f"{target}_from_{source}" for target, source in names)
            raise FrameError(
                f"poses for {what} have different frames: {given}; expected the same frames"
            )
        rotations = np.stack([pose.rotation for pose in poses])
        translations = np.stack([pose.translation_mm for pose in poses])
        turn = np.abs(rotations - rotations[0]).max()
        shift = np.abs(translations - translations[0]).max()
        if turn < SAME_POSE_RAD and shift < SAME_POSE_MM:
            raise DegenerateMotionError(
                f"the {len(poses)} poses for {what} are one pose repeated; expected a difference "
                f"of at least {SAME_POSE_MM:g} mm or {SAME_POSE_RAD:g} rad"
            )
        return cls(poses[0].target, poses[0].source, rotations, translations)

    def select(self, mask: NDArray[np.bool_]) -> "PoseStack":
        """Return the poses of a mask (n,)."""
        return PoseStack(self.target, self.source, self.rotations[mask], self.translations_mm[mask])

    def relative_rotations(self) -> FloatArray:
        """Rotation vectors (m, 3) in rad, in the source frame, between pairs of poses."""
        compared = np.unique(
            np.linspace(0, len(self.rotations) - 1, MAX_COMPARED).round().astype(int)
        )
        first, second = np.triu_indices(len(compared), k=1)
        rotations = self.rotations[compared]
        relative = np.swapaxes(rotations[first], 1, 2) @ rotations[second]
        return np.asarray(scipy.spatial.transform.Rotation.from_matrix(relative).as_rotvec())


def usable_poses(samples: Sequence[TrackedTransform]) -> tuple[Transform, ...]:
    """Return the transforms of the samples with status OK.

    Raises `NoValidSamplesError` if there is none.
    """
    poses = tuple(sample.transform for sample in samples if sample.transform is not None)
    if not poses:
        counts = Counter(sample.status for sample in samples)
        found = ", ".join(
            f"{count} {TrackingStatus(status).name}" for status, count in counts.items()
        )
        raise NoValidSamplesError(
            f"0 of {len(samples)} samples are OK ({found or 'none given'}); expected at least 1"
        )
    return poses


def select_poses(
    poses: Sequence[Transform],
    *,
    min_distance_mm: float = 3.0,
    min_angle_rad: float = np.radians(5.0),
) -> tuple[int, ...]:
    """Return indices of poses that differ from the last selected pose by both minima.

    Successive samples of slow motion have correlated errors and add little information. The first
    pose is always selected. Raises `TooFewError` for an empty list.
    """
    if not poses:
        raise TooFewError("0 poses to select from; expected at least 1")
    selected = [0]
    for index, pose in enumerate(poses[1:], start=1):
        last = poses[selected[-1]]
        if pose.distance_mm_to(last) >= min_distance_mm and pose.angle_to(last) >= min_angle_rad:
            selected.append(index)
    return tuple(selected)


@dataclass(frozen=True, slots=True)
class PoseNoise:
    """Standard deviation per axis of the rotation and the position of a measured pose.

    A 3-D root mean square is this times the square root of 3.
    """

    rotation_rad: float
    translation_mm: float

    def __post_init__(self) -> None:
        for name in ("rotation_rad", "translation_mm"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ShapeError(
                    f"{name} of the pose noise is {value}; expected a finite number above 0"
                )

    @classmethod
    def from_rms(cls, *, rotation_deg: float, translation_mm: float) -> "PoseNoise":
        """Construct from 3-D root mean squares, as in specifications of trackers."""
        return cls(math.radians(rotation_deg) / math.sqrt(3.0), translation_mm / math.sqrt(3.0))

    @property
    def sigmas(self) -> FloatArray:
        """Standard deviations (6,): three in rad, three in mm."""
        return np.repeat([self.rotation_rad, self.translation_mm], 3)
