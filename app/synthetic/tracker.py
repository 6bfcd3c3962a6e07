"""The electromagnetic tracker: jitter of each pose, and dropouts."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from app.geometry import FloatArray, TrackedTransform, TrackingStatus

DropoutKind = Literal["invalid", "missing"]


@dataclass(frozen=True, slots=True)
class Jitter:
    """White noise of each sample, as the RMS of 3-D error vectors.

    ``position_rms_mm`` is the RMS length of the error vector and ``angle_rms_rad`` that of the
    rotation vector, so each axis has a standard deviation of the RMS divided by sqrt(3).
    """

    position_rms_mm: float = 0.3
    angle_rms_rad: float = float(np.deg2rad(0.3))

    @property
    def deviations(self) -> FloatArray:
        """The standard deviations (6,) of displacement in mm and rotation vector in rad."""
        return np.asarray(np.repeat([self.position_rms_mm, self.angle_rms_rad], 3) / np.sqrt(3.0))


@dataclass(frozen=True, slots=True)
class Dropout:
    """An interval in which the tracker loses ``frames``, in s from the first tracker frame.

    ``invalid``: samples are marked INVALID and have no pose. ``missing``: there are no samples.
    """

    frames: tuple[str, ...]
    kind: DropoutKind
    start_s: float
    end_s: float

    def covers(self, time_s: float) -> bool:
        """True if the dropout includes ``time_s``."""
        return self.start_s <= time_s <= self.end_s


def reported(
    sample: TrackedTransform, dropouts: tuple[Dropout, ...], time_s: float
) -> TrackedTransform | None:
    """The sample as received: unchanged, marked INVALID, or None when it is missing."""
    for dropout in dropouts:
        if sample.source in dropout.frames and dropout.covers(time_s):
            if dropout.kind == "missing":
                return None
            return TrackedTransform.lost(
                sample.target, sample.source, sample.stamp, TrackingStatus.INVALID
            )
    return sample
