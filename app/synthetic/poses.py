"""Many poses between the same two frames, as arrays."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from app.geometry import FloatArray, Transform, mismatched_frames


@dataclass(frozen=True, slots=True, eq=False)
class Poses:
    """``target_from_source`` at n times: rotations (n, 3, 3) and translations (n, 3) in mm.

    The operations are those of `Transform`, on arrays; one transform is combined with all.
    """

    target: str
    source: str
    rotations: FloatArray
    translations_mm: FloatArray

    @classmethod
    def of(cls, transforms: Sequence[Transform]) -> "Poses":
        """Poses from n > 0 transforms between the same frames."""
        first = transforms[0]
        return cls(
            first.target,
            first.source,
            np.array([each.rotation for each in transforms]),
            np.array([each.translation_mm for each in transforms]),
        )

    def __matmul__(self, other: "Poses") -> "Poses":
        if self.source != other.target:
            raise mismatched_frames((self.target, self.source), (other.target, other.source))
        return Poses(
            self.target,
            other.source,
            np.matmul(self.rotations, other.rotations),
            _rotated(self.rotations, other.translations_mm) + self.translations_mm,
        )

    def inverse(self) -> "Poses":
        """Return ``source_from_target``."""
        rotations = np.ascontiguousarray(self.rotations.transpose(0, 2, 1))
        return Poses(
            self.source, self.target, rotations, -_rotated(rotations, self.translations_mm)
        )

    def apply(self, points_mm: FloatArray) -> FloatArray:
        """Map points (k, 3) in mm at each time: (n, k, 3)."""
        moved = np.matmul(points_mm, self.rotations.transpose(0, 2, 1))
        return np.asarray(moved + self.translations_mm[:, None])

    def transforms(self) -> list[Transform]:
        """Each pose as a `Transform`; the arrays become read-only."""
        self.rotations.setflags(write=False)
        self.translations_mm.setflags(write=False)
        return [
            Transform.of_read_only(self.target, self.source, rotation, translation_mm)
            for rotation, translation_mm in zip(self.rotations, self.translations_mm, strict=True)
        ]


def _rotated(rotations: FloatArray, vectors: FloatArray) -> FloatArray:
    return np.asarray(np.matmul(rotations, vectors[:, :, None])[:, :, 0])
