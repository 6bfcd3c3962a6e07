"""Lines of ``marginguard live``: time, colour and JSON."""

import io
import json
import os
import select
import threading
import time
from contextlib import suppress
from dataclasses import replace

import pytest

from app.cli.live_lines import (
    MAX_LINES,
    LinePrinter,
    LineQueue,
    as_json_line,
    as_line,
    local_time,
    uses_color,
)
from app.fixture import MarginState
from tests.bridge.conftest import content as content
from tests.bridge.conftest import make_step as make_step
from tests.cli.command import TerminalDouble

pytestmark = pytest.mark.slow

STAMP_NS = 1_700_000_000_123_456_789


@pytest.mark.parametrize(
    ("stamps_of_host", "expected"),
    [(True, "2023-11-14T22:13:20.123+00:00"), (False, "2023-11-14T22:13:21.000+00:00")],
)
def test_time_is_stamp_or_system_time(stamps_of_host, expected, monkeypatch):
    monkeypatch.setenv("TZ", "UTC")
    time.tzset()
    try:
        now_ns = 1_700_000_001_000_000_000
        assert local_time(STAMP_NS, stamps_of_host=stamps_of_host, now_ns=now_ns) == expected
    finally:
        monkeypatch.undo()
        time.tzset()


@pytest.mark.parametrize(
    ("stream", "environment", "expected"),
    [
        (TerminalDouble(), {}, True),
        (TerminalDouble(), {"TERM": "dumb"}, False),
        (TerminalDouble(), {"NO_COLOR": "1", "FORCE_COLOR": "1"}, False),
        (TerminalDouble(), {"NO_COLOR": ""}, True),
        (io.StringIO(), {}, False),
        (io.StringIO(), {"FORCE_COLOR": "1", "TERM": "dumb"}, True),
    ],
)
def test_environment_selects_colour(stream, environment, expected):
    assert uses_color(stream, environment) is expected


@pytest.mark.parametrize("state", list(MarginState))
def test_colour_is_accompanied_by_symbol_and_label(state, make_step):
    line = as_line(make_step(1, state=state), color=True)
    red, green, blue = (round(255 * part) for part in state.display.color)
    assert f"48;2;{red};{green};{blue}m {state.display.symbol} {state.display.label} " in line
    assert state.name in line.rpartition("\x1b[0m")[2]


def test_json_line_has_numbers_and_ids(make_step, content):
    step = make_step(1)
    found = json.loads(as_json_line(step, "now", content))
    assert found["stamp_ns"] == step.frame.stamp.ns
    assert found["oldest_stamp_ns"] == step.decision.stamp.ns
    assert (found["signed_distance_mm"], found["lower_bound_mm"]) == (7.5, 7.25)
    assert (found["stop_margin_mm"], found["warn_margin_mm"]) == (1.75, 5.75)
    assert (found["seq"], found["state"], found["reasons"]) == (1, "NEGATIVE", ["clear"])
    assert found["model_id"] == content.model_id


def test_unknown_values_are_null(make_step, content):
    found = json.loads(as_json_line(make_step(1, lost=True), "now", content))
    assert found["signed_distance_mm"] is found["stop_margin_mm"] is None
    assert (found["state"], found["hold"]) == ("UNKNOWN", True)
    without = replace(content, robot=None)
    assert json.loads(as_json_line(make_step(1), "now", without))["registration_id"] is None


@pytest.mark.parametrize("as_json", [True, False])
def test_one_step_is_one_line(as_json, make_step, content):
    stream = io.StringIO()
    printer = LinePrinter(stream, as_json=as_json, stamps_of_host=True)
    printer.print(make_step(1), content)
    printer.close()
    assert stream.getvalue().count("\n") == 1
    assert ("\x1b" in stream.getvalue()) is False


@pytest.fixture
def pipe():
    """A stream into a pipe, and the descriptor of its reader."""
    reader, writer = os.pipe()
    with os.fdopen(writer, "w") as stream:
        yield stream, reader
        with suppress(OSError):
            os.close(reader)


@pytest.mark.parametrize("as_json", [True, False])
def test_reader_that_does_not_read_delays_nothing_and_misses_a_counted_part(
    as_json, pipe, make_step, content
):
    stream, reader = pipe
    printer = LinePrinter(stream, as_json=as_json, stamps_of_host=True)
    step = make_step(1)
    printed = MAX_LINES + 3000  # more than the pipe holds; returns although nothing is read
    for _ in range(printed):
        printer.print(step, content)
    received = b""
    while not printer._lines._lines.empty():
        received += os.read(reader, 65536)
    printer.print(step, content)
    os.set_blocking(reader, True)
    thread = threading.Thread(target=printer.close)
    thread.start()
    while thread.is_alive() or select.select([reader], [], [], 0)[0]:
        if select.select([reader], [], [], 0.01)[0]:
            received += os.read(reader, 65536)
    lines = received.decode().splitlines()
    if as_json:
        missed = json.loads(lines[-1])["dropped_lines"]
        kept = len(lines)
    else:
        notices = [line for line in lines if "were dropped" in line]
        missed = sum(int(notice.split()[0]) for notice in notices)
        kept = len(lines) - len(notices)
    assert missed > 1000
    assert kept + missed == printed + 1


def test_reader_that_has_closed_the_pipe_is_an_error_of_a_later_line(pipe, make_step, content):
    stream, reader = pipe
    os.close(reader)
    printer = LinePrinter(stream, as_json=True, stamps_of_host=True)
    with pytest.raises(BrokenPipeError):
        while True:
            printer.print(make_step(1), content)


def test_close_does_not_wait_for_a_reader_that_does_not_read(pipe):
    stream, _ = pipe
    lines = LineQueue(stream, max_lines=2)
    for _ in range(2000):
        lines.put("x" * 1000)
    lines.close()  # returns
    assert lines.dropped > 0
