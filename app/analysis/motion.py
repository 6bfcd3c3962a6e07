"""Motion of the tool's tip relative to the tumour: path, speed, jerk, idle time.

The sum of the steps of a jittering tip is far too long, and its derivatives are noise. So the
positions are resampled to even times and smoothed by a local cubic (Savitzky and Golay 1964) of
`WINDOW_S`. ``path_mm`` is the length of the smoothed path; ``raw_path_mm`` is the sum of the
measured steps, as other programs give it. Smoothness is the logarithm of the dimensionless jerk
(Balasubramanian, Melendez-Calderon and Burdet 2012).
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from app.geometry import FloatArray

WINDOW_S = 0.4
IDLE_MM_S = 3.0
IDLE_S = 0.5
"""The tip is idle where its smoothed speed is below `IDLE_MM_S` for at least `IDLE_S`."""
_MIN_PIECE = 8


def savitzky_golay(
    values: FloatArray, length: int, degree: int, *, derivative: int = 0, step: float = 1.0
) -> FloatArray:
    """The columns of ``values`` (n, c), or their derivative, at the middle of each window.

    A polynomial is fitted in a moving window (Savitzky and Golay 1964).
    `scipy.signal.savgol_filter` gives the same, and takes half a second to load.

    ``length``: samples of a window, odd, at most n and more than ``degree``. ``step`` is the
    distance of two samples. The first and the last half of a window are the values of the
    polynomial of the first and the last window.
    """
    half = length // 2
    places = np.arange(-half, half + 1)
    fit = np.linalg.pinv(np.vander(places, degree + 1, increasing=True).astype(float))
    powers = np.arange(derivative, degree + 1)
    factors = np.array([math.perm(power, derivative) for power in powers]) / step**derivative
    # Rows: the polynomial's value at each place of the window, from the samples of the window.
    at_places = (places[:, None] ** (powers - derivative) * factors) @ fit[powers]
    windows = np.lib.stride_tricks.sliding_window_view(values, length, axis=0)
    middle = windows @ at_places[half]
    first, last = at_places[:half] @ values[:length], at_places[half + 1 :] @ values[-length:]
    return np.concatenate([first, middle, last])


@dataclass(frozen=True, slots=True)
class Motion:
    """Figures of the tip's motion; speeds in mm/s, jerk in mm/s^3. None where nothing was measured.

    ``tracked_s``: duration of the pieces without a gap, to which all figures refer.
    ``log_dimensionless_jerk`` is 0 or negative; nearer to 0 is smoother.
    """

    tracked_s: float
    path_mm: float
    raw_path_mm: float
    mean_speed_mm_s: float | None
    max_speed_mm_s: float | None
    rms_jerk_mm_s3: float | None
    log_dimensionless_jerk: float | None
    idle_s: float


@dataclass(frozen=True, slots=True, eq=False)
class SmoothPiece:
    """A piece without gaps at even times: ``times_s`` (m,), ``tips_mm``, ``velocities_mm_s``,
    ``jerks_mm_s3`` (m, 3).
    """

    times_s: FloatArray
    tips_mm: FloatArray
    velocities_mm_s: FloatArray
    jerks_mm_s3: FloatArray

    @property
    def speeds_mm_s(self) -> FloatArray:
        """Speed of the tip, (m,)."""
        return np.asarray(np.linalg.norm(self.velocities_mm_s, axis=1))


def smooth_pieces(
    times_s: FloatArray, tips_mm: FloatArray, max_gap_s: float
) -> Iterator[SmoothPiece]:
    """The tip's path, smoothed, in pieces without a gap longer than ``max_gap_s``.

    ``times_s`` (n,) and ``tips_mm`` (n, 3); rows with NaN and times that do not increase are left
    out. Pieces of fewer than 8 samples are left out, too.
    """
    known = np.isfinite(tips_mm).all(axis=1)
    times, tips = times_s[known], tips_mm[known]
    if len(times) < _MIN_PIECE:
        return
    highest = np.append(-np.inf, np.maximum.accumulate(times)[:-1])
    times, tips = times[times > highest], tips[times > highest]
    period_s = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    ends = np.flatnonzero(np.diff(times) > max_gap_s) + 1
    for rows in np.split(np.arange(len(times)), ends):
        if len(rows) < _MIN_PIECE:
            continue
        start, end = float(times[rows[0]]), float(times[rows[-1]])
        count = math.floor((end - start) / period_s + 1e-9) + 1
        even = np.asarray(start + period_s * np.arange(count), dtype=np.float64)
        if len(even) < _MIN_PIECE:
            continue
        path = np.column_stack([np.interp(even, times[rows], tips[rows, k]) for k in range(3)])
        yield _smoothed(even, path, period_s)


def smoothed_path(times_s: FloatArray, values: FloatArray) -> FloatArray:
    """The columns of ``values`` (n, c) at even times, smoothed: (m, c).

    ``times_s`` (n,) increase without a gap. A path of fewer than 8 samples is returned as it is.
    """
    if len(times_s) < _MIN_PIECE:
        return values
    period_s = float(np.median(np.diff(times_s)))
    count = math.floor((times_s[-1] - times_s[0]) / period_s + 1e-9) + 1
    even = np.minimum(times_s[0] + period_s * np.arange(count), times_s[-1])
    path = np.column_stack([np.interp(even, times_s, column) for column in values.T])
    length = _filter_length(count, period_s)
    return savitzky_golay(path, length, 3)


def motion_of(times_s: FloatArray, tips_mm: FloatArray, max_gap_s: float) -> Motion:
    """Figures of the path ``tips_mm`` (n, 3) at ``times_s`` (n,); arguments as `smooth_pieces`."""
    tracked_s = path_mm = idle_s = jerk_sum = 0.0
    speeds: list[FloatArray] = []
    for piece in smooth_pieces(times_s, tips_mm, max_gap_s):
        period_s = float(piece.times_s[1] - piece.times_s[0])
        tracked_s += float(piece.times_s[-1] - piece.times_s[0])
        path_mm += float(np.linalg.norm(np.diff(piece.tips_mm, axis=0), axis=1).sum())
        idle_s += _idle_s(piece.speeds_mm_s, period_s)
        jerk_sum += float((piece.jerks_mm_s3**2).sum()) * period_s
        speeds.append(piece.speeds_mm_s)
    raw_mm = raw_path_mm(times_s, tips_mm, max_gap_s)
    if not speeds or tracked_s <= 0.0:
        return Motion(0.0, 0.0, raw_mm, None, None, None, None, 0.0)
    fastest = float(np.concatenate(speeds).max())
    dimensionless = jerk_sum * tracked_s**3 / fastest**2 if fastest > 0.0 else 0.0
    return Motion(
        tracked_s,
        path_mm,
        raw_mm,
        path_mm / tracked_s,
        fastest,
        math.sqrt(jerk_sum / tracked_s),
        -math.log(dimensionless) if dimensionless > 0.0 else None,
        idle_s,
    )


def raw_path_mm(times_s: FloatArray, tips_mm: FloatArray, max_gap_s: float) -> float:
    """Sum of the distances between successive known tips, without those across a gap."""
    known = np.isfinite(tips_mm).all(axis=1)
    times, tips = times_s[known], tips_mm[known]
    steps, gaps = np.linalg.norm(np.diff(tips, axis=0), axis=1), np.diff(times)
    return float(steps[(gaps > 0.0) & (gaps <= max_gap_s)].sum())


def _smoothed(times: FloatArray, path: FloatArray, period_s: float) -> SmoothPiece:
    length = _filter_length(len(times), period_s)
    smooth, velocity, jerk = (
        savitzky_golay(path, length, 3, derivative=order, step=period_s) for order in (0, 1, 3)
    )
    return SmoothPiece(times, smooth, velocity, jerk)


def _filter_length(count: int, period_s: float) -> int:
    """Samples of the window, an odd number of at most ``count``."""
    length = max(5, 2 * round(0.5 * WINDOW_S / period_s) + 1)
    return length if length <= count else count - 1 + count % 2


def _idle_s(speeds: FloatArray, period_s: float) -> float:
    slow = np.concatenate([[False], speeds < IDLE_MM_S, [False]]).astype(np.int8)
    starts, ends = np.flatnonzero(np.diff(slow) == 1), np.flatnonzero(np.diff(slow) == -1)
    durations = (ends - starts) * period_s
    return float(durations[durations >= IDLE_S].sum())
