"""Progress of long work: a bar with the total on a terminal, nothing elsewhere."""

import io
import sys

from app.cli.progress import progress_with_total


class TerminalDouble(io.StringIO):
    """Test double of a terminal."""

    def isatty(self):
        return True


def shown(stream, monkeypatch):
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setenv("TERM", "xterm")
    with progress_with_total("simulating frame") as report:
        report(3, 10)
    return stream.getvalue()


def test_terminal_shows_total(monkeypatch):
    text = shown(TerminalDouble(), monkeypatch)
    assert "simulating frame" in text
    assert "3/10" in text


def test_pipe_gets_nothing(monkeypatch):
    assert shown(io.StringIO(), monkeypatch) == ""
