"""Progress of long work: a bar with the total on a terminal, nothing elsewhere."""

import io
import sys

import pytest

from app.cli.progress import announce_duration, progress_with_total, with_progress
from tests.cli.command import TerminalDouble


@pytest.fixture
def shown(monkeypatch):
    """``shown(work, stream)``: what ``work`` shows on a terminal, or on another stream."""

    def run(work, stream=None):
        stream = TerminalDouble() if stream is None else stream
        monkeypatch.setattr(sys, "stderr", stream)
        monkeypatch.setenv("TERM", "xterm")
        work()
        return stream.getvalue()

    return run


def report_three_of_ten():
    with progress_with_total("simulating frame") as report:
        report(3, 10)


def test_terminal_shows_total_and_a_pipe_gets_nothing(shown):
    text = shown(report_three_of_ten)
    assert "simulating frame" in text and "3/10" in text
    assert shown(report_three_of_ten, io.StringIO()) == ""


@pytest.mark.parametrize(("items", "count"), [(["a", "b", "c"], "3/3"), (iter("ab"), "2/?")])
def test_length_of_a_collection_is_its_total_and_an_unknown_one_is_counted(shown, items, count):
    assert count in shown(lambda: list(with_progress(items, "turn")))


def test_output_for_a_file_is_not_shown_on_the_terminal(shown, monkeypatch):
    file = io.StringIO()
    monkeypatch.setattr(sys, "stdout", file)
    text = shown(lambda: [print(each) for each in with_progress(["figure 1"], "topic")])
    assert file.getvalue() == "figure 1\n"
    assert "figure 1" not in text


def test_duration_is_announced_on_a_terminal_only(shown):
    assert shown(lambda: announce_duration("stepping", 60.0)).startswith("stepping: 60 s, until ")
    assert shown(lambda: announce_duration("stepping", 60.0), io.StringIO()) == ""
