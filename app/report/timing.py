"""Computing time of the steps of a replay."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

_NS_PER_US = 1000.0


@dataclass(frozen=True, slots=True)
class StepTiming:
    """Percentiles of the duration of one step, in microseconds."""

    p50_us: float
    p99_us: float
    max_us: float

    @classmethod
    def from_durations(cls, durations_ns: Sequence[int]) -> Self | None:
        """Compute from one duration per step, in ns; None without a step."""
        if len(durations_ns) == 0:
            return None
        in_us = np.asarray(durations_ns, dtype=np.float64) / _NS_PER_US
        p50, p99 = np.percentile(in_us, (50.0, 99.0)).tolist()
        return cls(p50, p99, float(in_us.max()))
