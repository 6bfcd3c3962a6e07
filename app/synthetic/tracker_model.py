"""Errors of a tracker in a pose and its time, as numbers: rate, noise, digits, losses, presets.

The model is data only; `SimulatedTracker` applies it. Values of the presets without a source are
assumptions, and are named as such. Sources:

- [QA] "Performance assessment of surgical tracking systems based on statistical process control and
  longitudinal QA", Computer Assisted Surgery 28, 2023, doi:10.1080/24699322.2023.2275522: upper
  control limits of the jitter 0.30 to 0.33 mm (two Aurora), 0.08 to 0.10 mm (Spectra, Vega, Vicra).
- [Vega] "Technical assessment of the NDI Polaris Vega optical tracking system", Radiation Oncology
  16, 2021, doi:10.1186/s13014-021-01804-7: latency 14.2 +- 1.8 ms, static error 0.045 mm RMS.
- [Eight] the recording EightLandmarkPointsTrackedForPhantomRegistration of PlusLibData (BSD-3), as
  measured by `tests/synthetic/recorded_statistics.py`: positions in steps of 144 in / 32768
  = 0.1116 mm; at rest a jitter of 0.11 and 0.22 mm RMS (pointer, reference), 0.18 and 0.05 degrees,
  autocorrelation time 0.05 and 0.11 s, of which a quarter to a half of the positions repeat; every
  250th frame is missing, every 200th repeats the one before.
- [RAS] the recording ReferenceToRASCalibration of PlusLibData: positions in steps of 0.01 mm, a
  jitter of 0.06 mm and 0.014 degrees RMS at rest, autocorrelation time 0.2 s.

NDI's text protocol reports positions in 0.01 mm and quaternions in 0.0001, for Aurora and Polaris.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from app.geometry import FloatArray, InputError, TrackedTransform, TrackingStatus

DropoutKind = Literal["invalid", "missing"]
RotationDigits = Literal["exact", "quaternion", "euler"]
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
_DEG = float(np.deg2rad(1.0))


def check_range(what: str, value: float | None, low: float, high: float, unit: str = "") -> None:
    """Raise `InputError` for a value that is not from ``low`` to ``high``; None is not given."""
    if value is not None and not low <= value <= high:
        raise InputError(f"{what} is {value:g}{unit}; expected {low:g} to {high:g}{unit}")


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
        check_range("distortion: shift_mm", self.shift_mm, 0.0, 5.0)
        check_range("distortion: turn_rad", self.turn_rad, 0.0, 0.1)

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
        what = f"tracker {self.name!r}"
        for name, (low, high) in _RANGES.items():
            check_range(f"{what}: {name}", getattr(self, name), low, high)
        for name, jitter in (("white", self.white), ("slow", self.slow)):
            check_range(f"{what}: {name}.position_rms_mm", jitter.position_rms_mm, 0.0, 5.0)
            check_range(f"{what}: {name}.angle_rms_rad", jitter.angle_rms_rad, 0.0, 0.1)

    @property
    def period_s(self) -> float:
        """Mean time between two acquisitions."""
        return 1.0 / self.rate_hz


WHITE = TrackerModel("white", 50.0, Jitter())
"""Regular times, white noise of 0.3 mm and 0.3 degrees RMS, exact digits: no real tracker."""

AURORA = TrackerModel(
    "aurora",
    40.0,
    white=Jitter(0.12, 0.06 * _DEG),
    slow=Jitter(0.16, 0.08 * _DEG),
    correlation_s=0.4,
    latency_s=0.030,
    period_sd_s=0.0002,
    stamp_sd_s=0.002,
    skipped=0.002,
    repeated=0.004,
    lost=0.001,
    position_quantum_mm=0.01,
    rotation_digits="quaternion",
    rotation_quantum=1e-4,
    distortion=Distortion(1.0, 0.3 * _DEG, 60.0),
)
"""Electromagnetic, like NDI Aurora at its 40 Hz.

Jitter of 0.2 mm RMS, below the control limit of [QA]. Assumed: the split into a white and a slow
part, orientation noise, latency, shares of losses, and a distortion of 0.5 mm at the tool's sensor.
"""

TRAKSTAR = TrackerModel(
    "trakstar",
    80.0,
    white=Jitter(0.03, 0.12 * _DEG),
    slow=Jitter(0.12, 0.06 * _DEG),
    correlation_s=0.15,
    latency_s=0.020,
    period_sd_s=0.00006,
    stamp_sd_s=0.00004,
    skipped=0.004,
    repeated=0.005,
    lost=0.001,
    position_quantum_mm=144.0 * 25.4 / 32768.0,
    rotation_digits="euler",
    rotation_quantum=float(np.pi) / 32768.0,
    distortion=Distortion(1.0, 0.3 * _DEG, 60.0),
)
"""Electromagnetic, like Ascension trakSTAR at 80 Hz, with the digits, times and jitter of [Eight].

Assumed: latency, losses, digits of the angles (180 degrees / 32768), distortion.
"""

POLARIS = TrackerModel(
    "polaris",
    60.0,
    white=Jitter(0.02, 0.010 * _DEG),
    slow=Jitter(0.06, 0.012 * _DEG),
    correlation_s=0.5,
    latency_s=0.0142,
    period_sd_s=0.0001,
    stamp_sd_s=0.0018,
    skipped=0.001,
    repeated=0.01,
    lost=0.003,
    position_quantum_mm=0.01,
    rotation_digits="quaternion",
    rotation_quantum=1e-4,
)
"""Optical, like NDI Polaris Vega at 60 Hz: no distortion, and more lost samples (line of sight).

Latency and its spread from [Vega], jitter and its correlation from [RAS], below the control limit
of [QA]. Assumed: spread of the intervals, shares of losses.
"""

PRESETS = {model.name: model for model in (WHITE, AURORA, TRAKSTAR, POLARIS)}


def tracker_preset(name: str) -> TrackerModel:
    """The preset ``name``; raises `InputError` for another name."""
    if name not in PRESETS:
        raise InputError(f"tracker {name!r} is not known; expected {', '.join(PRESETS)}")
    return PRESETS[name]
