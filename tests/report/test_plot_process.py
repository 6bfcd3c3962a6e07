"""``margin.png`` from another process: the same bytes, also if that process is killed."""

import time
from collections.abc import Callable

import psutil
import pytest

from app.report import ReplayRecord, ReportError, draw_margin_plot, margin_plot_process

Record = Callable[..., ReplayRecord]


def kill_new_child(known: set[psutil.Process]) -> None:
    """Kill the child that is not ``known``; fails if none starts within a minute."""
    deadline = time.monotonic() + 60.0
    while not (started := set(psutil.Process().children()) - known):
        assert time.monotonic() < deadline
        time.sleep(0.01)
    for child in started:
        child.kill()


def test_plot_of_the_process_has_the_same_bytes(record_of: Record) -> None:
    record = record_of([6.0, 3.0, -1.0])
    with margin_plot_process(record) as margin_plot:
        drawn = margin_plot()
    assert drawn == draw_margin_plot(record.rows, record.margins, record.case)
    assert drawn.startswith(b"\x89PNG")


def test_plot_is_drawn_here_after_the_process_was_killed(record_of: Record) -> None:
    record = record_of([6.0, 3.0, -1.0])
    known = set(psutil.Process().children())
    with margin_plot_process(record) as margin_plot:
        kill_new_child(known)
        drawn = margin_plot()
    assert drawn == draw_margin_plot(record.rows, record.margins, record.case)


def test_replay_without_frames_raises(record_of: Record) -> None:
    with pytest.raises(ReportError, match="0 frames"), margin_plot_process(record_of([])):
        pass
