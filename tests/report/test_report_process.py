"""Parts of a report from another process: the same bytes, also if that process is killed."""

import os
import signal

import pytest

from app.geometry import InputError
from app.report import ReportError, ReportProcess, draw_margin_plot

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def process():
    with ReportProcess(()) as process:
        yield process


def test_replay_without_frames_raises(process, record_of):
    with pytest.raises(ReportError, match="0 frames"):
        process.begin_margin_plot(record_of([]))


def test_plot_of_the_process_has_the_same_bytes(process, record_of):
    record = record_of([6.0, 3.0, -1.0])
    plot = process.begin_margin_plot(record)
    drawn = plot.wait()
    assert drawn == draw_margin_plot(record.rows, record.margins, record.case)
    assert drawn.startswith(b"\x89PNG")
    assert plot.processor_s > 0.0


def end_in_another_process(here):
    """Kill the process, unless it is ``here``."""
    if os.getpid() != here:
        os.kill(os.getpid(), signal.SIGKILL)
    return "made here"


def test_part_is_made_here_after_the_process_was_killed(process):
    part = process.begin(end_in_another_process, lambda: (os.getpid(),))
    with pytest.raises(InputError, match="ended with status -9"):
        part.wait()
    assert part.wait_or_make() == "made here"
    following = process.begin(len, lambda: ("the next process",))
    assert following.wait() == 16
