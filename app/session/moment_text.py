"""Text of a moment: the time of day, and seconds since the first step."""

from datetime import datetime

from app.geometry import NS_PER_S

_FIRST_UNIX_NS = 10**18
"""Stamps below it (2001) are not of a clock that counts from 1970: they have no time of day."""


def moment_text(stamp_ns: int, elapsed_s: float) -> str:
    """Local time of day of ``stamp_ns`` and ``elapsed_s``: ``14:03:21, 12.3 s``.

    Seconds alone for a stamp of a clock that does not count from 1970.
    """
    seconds = f"{elapsed_s:.1f} s"
    if stamp_ns < _FIRST_UNIX_NS:
        return seconds
    return f"{datetime.fromtimestamp(stamp_ns // NS_PER_S):%H:%M:%S}, {seconds}"
