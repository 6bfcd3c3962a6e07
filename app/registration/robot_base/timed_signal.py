"""A sampled signal with acquisition times on one clock."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.geometry import FloatArray, StampError, TrackedTransform
from app.registration.errors import NotFiniteError, ShapeError, UnequalCountsError
from app.registration.inputs import as_floats
from app.registration.poses import usable_poses


@dataclass(frozen=True, slots=True, eq=False)
class TimedSignal:
    """``values`` (n, d) at increasing ``times_ns`` (n,) on ``clock``.

    Values (n,) become (n, 1). Arrays are copied and read-only. Raises `ShapeError`,
    `UnequalCountsError` or `NotFiniteError`.
    """

    times_ns: NDArray[np.int64]
    values: FloatArray
    clock: str

    def __post_init__(self) -> None:
        times = np.array(self.times_ns)
        values = as_floats(self.values, f"values of signal {self.clock!r}")
        if values.ndim == 1:
            values = values[:, None]
        if times.dtype.kind not in "iu" or times.ndim != 1:
            raise ShapeError(
                f"times of signal {self.clock!r} are {times.dtype} of shape {times.shape}; "
                "expected integer ns of shape (n,)"
            )
        if values.ndim != 2 or len(values) != len(times):
            raise UnequalCountsError(
                f"signal {self.clock!r} has {len(times)} times and values of shape {values.shape}; "
                "expected one value per time"
            )
        finite = np.isfinite(values).all(axis=1)
        if not finite.all():
            first = int(np.argmin(finite))
            raise NotFiniteError(
                f"value {first} of signal {self.clock!r} is {values[first].tolist()}; "
                "expected finite numbers"
            )
        if np.any(np.diff(times) <= 0):
            late = int(np.argmin(np.diff(times))) + 1
            raise ShapeError(
                f"time {late} of signal {self.clock!r} is not after the previous one; "
                "expected increasing times"
            )
        times = times.astype(np.int64)
        times.flags.writeable = False
        values.flags.writeable = False
        object.__setattr__(self, "times_ns", times)
        object.__setattr__(self, "values", values)

    @classmethod
    def from_positions(cls, samples: Sequence[TrackedTransform]) -> "TimedSignal":
        """Positions (n, 3) in mm of the source frame at the OK samples of a recording."""
        return cls._from_samples(samples, rotations=False)

    @classmethod
    def from_poses(cls, samples: Sequence[TrackedTransform]) -> "TimedSignal":
        """Rotation matrices and positions (n, 12) of the source frame at the OK samples.

        The position of a point fixed to the source frame, in a frame fixed to the target frame, is
        a linear function of these 12 numbers. So robot and sensor poses can be aligned in time
        before their registration is known.
        """
        return cls._from_samples(samples, rotations=True)

    @classmethod
    def _from_samples(
        cls, samples: Sequence[TrackedTransform], *, rotations: bool
    ) -> "TimedSignal":
        poses = usable_poses(samples)
        stamps = [sample.stamp for sample in samples if sample.transform is not None]
        clocks = {stamp.clock for stamp in stamps}
        if len(clocks) > 1:
            raise StampError(
                f"samples of one signal are on several clocks: {sorted(clocks)}; expected one clock"
            )
        rows = [
            np.concatenate([pose.rotation.ravel(), pose.translation_mm])
            if rotations
            else pose.translation_mm
            for pose in poses
        ]
        return cls(
            np.array([stamp.ns for stamp in stamps], dtype=np.int64),
            np.stack(rows),
            stamps[0].clock,
        )
