"""Presets of trackers. Values without a source are assumptions, and are named as such.

Sources:

- [QA] "Performance assessment of surgical tracking systems based on statistical process control and
  longitudinal QA", Computer Assisted Surgery 28, 2023, doi:10.1080/24699322.2023.2275522: upper
  control limits of the jitter 0.30 to 0.33 mm (two Aurora), 0.08 to 0.10 mm (Spectra, Vega, Vicra).
- [Vega] "Technical assessment of the NDI Polaris Vega optical tracking system", Radiation Oncology
  16, 2021, doi:10.1186/s13014-021-01804-7: latency 14.2 +- 1.8 ms, static error 0.045 mm RMS.
- [Eight] the recording EightLandmarkPointsTrackedForPhantomRegistration of PlusLibData (BSD-3), as
  measured by `tests/synthetic/recorded_statistics.py`: positions in steps of 144 in / 32768
  = 0.1116 mm; at rest a jitter of 0.11 and 0.22 mm RMS (stylus, reference), 0.18 and 0.05 degrees,
  autocorrelation time 0.05 and 0.11 s, of which a quarter to a half of the positions repeat; every
  250th frame is missing, every 200th repeats the one before.
- [RAS] the recording ReferenceToRASCalibration of PlusLibData: positions in steps of 0.01 mm, a
  jitter of 0.06 mm and 0.014 degrees RMS at rest, autocorrelation time 0.2 s.

NDI's text protocol reports positions in 0.01 mm and quaternions in 0.0001, for Aurora and Polaris.
"""

import numpy as np

from app.geometry import InputError
from app.synthetic.tracker import Jitter
from app.synthetic.tracker_model import Distortion, TrackerModel

_DEG = float(np.deg2rad(1.0))

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
