"""A stream of numbers with the times at which they were acquired, on one clock."""

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
    """``values`` (n, d) at ``times_ns`` (n,) of ``clock``, in rising order of time.

    One number a time, (n,), is taken as (n, 1). Arrays are copied and read-only.
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
                f"times of signal {self.clock!r} are {times.dtype} of shape {times.shape}: "
                "integer ns of shape (n,) wanted"
            )
        if values.ndim != 2 or len(values) != len(times):
            raise UnequalCountsError(
                f"signal {self.clock!r} has {len(times)} times and values of shape {values.shape}"
            )
        finite = np.isfinite(values).all(axis=1)
        if not finite.all():
            first = int(np.argmin(finite))
            raise NotFiniteError(
                f"value {first} of signal {self.clock!r} is {values[first].tolist()}: "
                "finite numbers wanted"
            )
        if np.any(np.diff(times) <= 0):
            late = int(np.argmin(np.diff(times))) + 1
            raise ShapeError(
                f"time {late} of signal {self.clock!r} is not after the one before: "
                "rising times wanted"
            )
        times = times.astype(np.int64)
        times.flags.writeable = False
        values.flags.writeable = False
        object.__setattr__(self, "times_ns", times)
        object.__setattr__(self, "values", values)

    @classmethod
    def of_positions(cls, samples: Sequence[TrackedTransform]) -> "TimedSignal":
        """Where the source frame was, (n, 3) in mm, at the good samples of a recording."""
        return cls._of(samples, rotations=False)

    @classmethod
    def of_poses(cls, samples: Sequence[TrackedTransform]) -> "TimedSignal":
        """Where it was and how it was turned, (n, 12).

        The position of anything rigidly fixed to the source frame, in any frame rigidly fixed to
        the target frame, is a linear image of these twelve: robot and sensor poses can be aligned
        before their registration is known.
        """
        return cls._of(samples, rotations=True)

    @classmethod
    def _of(cls, samples: Sequence[TrackedTransform], *, rotations: bool) -> "TimedSignal":
        poses = usable_poses(samples)
        stamps = [sample.stamp for sample in samples if sample.transform is not None]
        clocks = {stamp.clock for stamp in stamps}
        if len(clocks) > 1:
            raise StampError(f"samples of one signal are on several clocks: {sorted(clocks)}")
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
