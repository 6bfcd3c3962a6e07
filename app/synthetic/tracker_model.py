"""Errors of a tracker in a pose and its time, as numbers: rate, noise, digits, distortion.

The model is data only. `app.synthetic.simulated_tracker` applies it.
"""

from dataclasses import dataclass
from typing import Literal

from app.geometry import InputError
from app.synthetic.tracker import Jitter

RotationDigits = Literal["exact", "quaternion", "euler"]

NO_JITTER = Jitter(0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Distortion:
    """Error of a magnetic field near metal: smooth in space, constant in time.

    At a distance ``d`` from the metal the sensor appears displaced by ``shift_mm * f`` and turned
    by ``turn_rad * f``, with ``f = 1 / (1 + (d / reach_mm)^4)``: half of it at ``reach_mm``.
    """

    shift_mm: float
    turn_rad: float
    reach_mm: float

    def __post_init__(self) -> None:
        for name, limit in (("shift_mm", 5.0), ("turn_rad", 0.1)):
            if not 0.0 <= getattr(self, name) <= limit:
                raise InputError(
                    f"distortion: {name} is {getattr(self, name):g}; expected 0 to {limit:g}"
                )

    def share(self, distance_mm: float) -> float:
        """The factor ``f``, 0 to 1."""
        return float(1.0 / (1.0 + (distance_mm / self.reach_mm) ** 4))


@dataclass(frozen=True, slots=True)
class TrackerModel:
    """A tracker: when it measures, with which errors, and in which digits it reports.

    ``white`` differs from sample to sample; ``slow`` is a stationary Gauss-Markov process with the
    autocorrelation ``exp(-dt / correlation_s)``. Both are RMS lengths of 3-D vectors, for each
    sensor on its own. ``period_sd_s`` is the spread of the time between two acquisitions,
    ``stamp_sd_s`` that of a stamp about its acquisition plus ``latency_s``. ``skipped`` frames
    never arrive, ``repeated`` frames hold the poses of the one before with a new stamp, ``lost``
    samples are marked INVALID: each is a share of all. Positions are rounded to
    ``position_quantum_mm``, rotations to ``rotation_quantum``: a component of the
    quaternion, or an Euler angle in rad.
    """

    name: str
    rate_hz: float
    white: Jitter
    slow: Jitter = NO_JITTER
    correlation_s: float = 1.0
    latency_s: float = 0.0
    period_sd_s: float = 0.0
    stamp_sd_s: float = 0.0
    skipped: float = 0.0
    repeated: float = 0.0
    lost: float = 0.0
    position_quantum_mm: float = 0.0
    rotation_digits: RotationDigits = "exact"
    rotation_quantum: float = 0.0
    distortion: Distortion = Distortion(0.0, 0.0, 60.0)

    def __post_init__(self) -> None:
        for name, (low, high) in _RANGES.items():
            value = getattr(self, name)
            if not low <= value <= high:
                raise InputError(
                    f"tracker {self.name!r}: {name} is {value:g}; expected {low:g} to {high:g}"
                )
        for name, jitter in (("white", self.white), ("slow", self.slow)):
            for part, limit in (("position_rms_mm", 5.0), ("angle_rms_rad", 0.1)):
                value = getattr(jitter, part)
                if not 0.0 <= value <= limit:
                    raise InputError(
                        f"tracker {self.name!r}: {name}.{part} is {value:g}; "
                        f"expected 0 to {limit:g}"
                    )

    @property
    def period_s(self) -> float:
        """Mean time between two acquisitions."""
        return 1.0 / self.rate_hz


_RANGES = {
    "rate_hz": (1.0, 250.0),
    "correlation_s": (0.001, 60.0),
    "latency_s": (0.0, 0.2),
    "period_sd_s": (0.0, 0.02),
    "stamp_sd_s": (0.0, 0.02),
    "skipped": (0.0, 0.05),
    "repeated": (0.0, 0.5),
    "lost": (0.0, 0.02),
    "position_quantum_mm": (0.0, 1.0),
    "rotation_quantum": (0.0, 0.01),
}
"""Field -> allowed values."""
