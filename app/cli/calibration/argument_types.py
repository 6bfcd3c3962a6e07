"""Types of the options of ``marginguard calibrate``, for `argparse`."""

import argparse
import math

MAX_AGE_MS = 60_000.0
MAX_RATE_HZ = 20_000.0
MAX_OFFSET_MS = 4e12
"""More than a century: one clock may count from 1970, and the other from its own start."""


def number(text: str) -> float:
    """A number, possibly infinite."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if math.isnan(value):
        raise argparse.ArgumentTypeError(f"{text!r} is not a number; expected a number")
    return value


def age_ms(text: str) -> float:
    """A time difference in ms, 0 to `MAX_AGE_MS`."""
    value = number(text)
    if not 0.0 <= value <= MAX_AGE_MS:
        raise argparse.ArgumentTypeError(
            f"{text!r} is out of range; expected 0 to {MAX_AGE_MS:g} ms"
        )
    return value


def clock_offset_ms(text: str) -> float:
    """A clock offset in ms, at most `MAX_OFFSET_MS` in size."""
    value = number(text)
    if not abs(value) <= MAX_OFFSET_MS:
        raise argparse.ArgumentTypeError(
            f"{text!r} is out of range; expected -{MAX_OFFSET_MS:g} to {MAX_OFFSET_MS:g} ms"
        )
    return value


def rate_hz(text: str) -> float:
    """A rate in Hz, above 0 and at most `MAX_RATE_HZ`."""
    value = number(text)
    if not 0.0 < value <= MAX_RATE_HZ:
        raise argparse.ArgumentTypeError(
            f"{text!r} is out of range; expected more than 0 and at most {MAX_RATE_HZ:g} Hz"
        )
    return value


def frame_name(text: str) -> str:
    """The name of a frame, not empty."""
    if not text:
        raise argparse.ArgumentTypeError("name of the frame is empty; expected a frame name")
    return text
