"""Clock of this host for validities: it is not set, and goes on while the machine sleeps."""

import time


def steady_ns() -> int:
    """Time in ns since the machine was started, including the time for which it was suspended.

    `time.monotonic_ns` stands still while a machine sleeps: data would stay valid for that long.
    """
    return time.clock_gettime_ns(time.CLOCK_BOOTTIME)
