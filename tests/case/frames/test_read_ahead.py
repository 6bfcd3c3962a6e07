"""Reading ahead keeps frames and their order, and reads one block at a time."""

from collections.abc import Iterator

import pytest

from app.case.frames.read_ahead import AHEAD, read_ahead
from app.case.frames.samples import TrackingFrame
from app.geometry import InputError, Stamp


def frames(count: int, read: list[int]) -> Iterator[TrackingFrame]:
    for ns in range(count):
        read.append(ns)
        yield TrackingFrame(Stamp(ns), ())


@pytest.mark.parametrize("count", [0, 1, AHEAD, AHEAD + 1, 3 * AHEAD])
def test_frames_are_yielded_in_order(count: int) -> None:
    assert [f.stamp.ns for f in read_ahead(frames(count, []))] == list(range(count))


def test_one_block_is_read_for_the_first_frame() -> None:
    read: list[int] = []
    next(read_ahead(frames(10 * AHEAD, read)))
    assert len(read) == AHEAD


def test_reader_error_is_raised_after_the_frames_before_it() -> None:
    def broken() -> Iterator[TrackingFrame]:
        yield from frames(AHEAD + 5, [])
        raise InputError("no more")

    ahead = read_ahead(broken())
    before = AHEAD + 5
    assert [next(ahead).stamp.ns for _ in range(before)] == list(range(before))
    with pytest.raises(InputError, match="no more"):
        next(ahead)
