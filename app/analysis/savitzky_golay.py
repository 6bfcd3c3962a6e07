"""Smoothing by a polynomial that is fitted in a moving window (Savitzky and Golay 1964).

`scipy.signal.savgol_filter` gives the same, and takes half a second to load.
"""

import math

import numpy as np

from app.geometry import FloatArray


def savitzky_golay(
    values: FloatArray, length: int, degree: int, *, derivative: int = 0, step: float = 1.0
) -> FloatArray:
    """The columns of ``values`` (n, c), or their derivative, at the middle of each window.

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
