"""Reads frames in blocks.

A replay that reads one frame and then steps it is slower by a tenth: reading and stepping evict
each other's code and data from the processor's caches.
"""

from collections.abc import Iterator
from itertools import islice

from app.case.frames.samples import TrackingFrame

AHEAD = 32
"""Frames per block: two thirds of a second at 50 Hz, read in about 2 ms."""


def read_ahead(frames: Iterator[TrackingFrame]) -> Iterator[TrackingFrame]:
    """Yield ``frames``, read in blocks of `AHEAD`.

    Frames before an error are yielded before it is raised.
    """
    while True:
        block: list[TrackingFrame] = []
        try:
            block.extend(islice(frames, AHEAD))
        except Exception:
            yield from block
            raise
        if not block:
            return
        yield from block
