"""Clock offset between two signals, compared with the correlation of principal axes."""

from collections.abc import Iterator

import numpy as np

from app.geometry import FloatArray
from app.registration import TimedSignal, estimate_time_offset
from benchmarks.registration.figures import Figure, rms
from tests.registration.time_signals import LAG_MS, streams


def time_offsets(trials: int) -> Iterator[Figure]:
    """Yield the error of the offset and the coverage of its interval."""
    rng = np.random.default_rng(6)
    errors, peers, covered = [], [], 0
    for _ in range(trials):
        a, b = streams(rng)
        result = estimate_time_offset(a, b)
        errors.append(result.offset_ns / 1e6 - LAG_MS)
        covered += result.interval_ns[0] <= LAG_MS * 1e6 <= result.interval_ns[1]
        peers.append(principal_axis_offset(a, b) - LAG_MS)
    yield Figure(
        "time offset",
        f"65 ms at 50 Hz with jitter, 20 s, {trials} trials",
        f"{rms(errors):.3f} RMS, {np.abs(errors).max():.3f} max ms",
        "1 ms",
        f"principal axis at 1 ms steps {rms(peers):.2f} RMS, {np.abs(peers).max():.1f} max ms",
        bool(np.quantile(np.abs(errors), 0.95) <= 1.0),
    )
    yield Figure(
        "time offset",
        "coverage of the 95 % interval",
        f"{covered / trials:.1%}",
        "95 %",
        "not available in other implementations",
        covered / trials >= 0.925,
    )


def principal_axis_offset(a: TimedSignal, b: TimedSignal) -> float:
    """Offset in ms as in PLUS: least squares of resampled positions along the principal axis."""

    def principal_component(signal: TimedSignal) -> tuple[FloatArray, FloatArray]:
        centred = signal.values - signal.values.mean(axis=0)
        axis = np.linalg.svd(centred, full_matrices=False)[2][0]
        values = centred @ axis
        return signal.times_ns / 1e9, values / values.std()

    (a_times, a_values), (b_times, b_values) = principal_component(a), principal_component(b)
    grid = np.arange(b_times[0] + 0.6, b_times[-1] - 0.6, 0.01)
    resampled = np.interp(grid, b_times, b_values)
    steps = np.arange(-0.5, 0.5005, 0.001)
    losses = [
        min(
            np.sum((resampled - sign * np.interp(grid - s, a_times, a_values)) ** 2)
            for sign in (1, -1)
        )
        for s in steps
    ]
    return float(1e3 * steps[int(np.argmin(losses))])
