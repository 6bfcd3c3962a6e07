"""Signals of one motion on two clocks, with a known offset."""

import numpy as np

from app.geometry import FloatArray
from app.registration import TimedSignal

LAG_MS = 65.0


class Motion:
    """Smooth motion like that of a hand: six slow sine waves per axis."""

    def __init__(self, rng: np.random.Generator, axes: int, amplitude: float) -> None:
        self.hertz = rng.uniform(0.1, 1.2, (6, axes))
        self.phase = rng.uniform(0.0, 2.0 * np.pi, (6, axes))
        self.amplitude = rng.normal(size=(6, axes)) * amplitude / (1.0 + 2.0 * self.hertz)

    def __call__(self, times: FloatArray) -> FloatArray:
        waves = np.sin(2.0 * np.pi * self.hertz * times[:, None, None] + self.phase)
        return (self.amplitude * waves).sum(axis=1)


def sample_times(rng: np.random.Generator, rate_hz: float, seconds: float) -> FloatArray:
    count = int(rate_hz * seconds)
    return (np.arange(count) + rng.uniform(-0.15, 0.15, count)) / rate_hz


def in_ns(seconds: FloatArray) -> FloatArray:
    return np.round(seconds * 1e9).astype(np.int64)


def streams(
    rng: np.random.Generator,
    *,
    noise_mm: float = 0.3,
    rate_hz: float = 50.0,
    seconds: float = 20.0,
    axes: int = 3,
) -> tuple[TimedSignal, TimedSignal]:
    """Two signals of one motion in two frames; the clock of b is `LAG_MS` ahead."""
    motion = Motion(rng, axes, 12.0)
    a_times, b_times = (sample_times(rng, rate, seconds) for rate in (rate_hz, 50.0))
    mixed = np.linalg.qr(rng.normal(size=(axes, axes)))[0]
    a = motion(a_times) + rng.normal(scale=noise_mm, size=(len(a_times), axes))
    b = motion(b_times) @ mixed.T + rng.normal(scale=noise_mm, size=(len(b_times), axes)) + 100.0
    return (
        TimedSignal(in_ns(a_times), a, "robot"),
        TimedSignal(in_ns(b_times + 1e-3 * LAG_MS), b, "tracker"),
    )
