"""Progress of long work: a bar with the total on a terminal, nothing elsewhere."""

import io
import sys

from app.cli.progress import announce_duration, progress_with_total, with_progress


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


def test_collection_has_its_length_as_total(monkeypatch):
    stream = TerminalDouble()
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setenv("TERM", "xterm")
    assert list(with_progress(["a", "b", "c"], "turn")) == ["a", "b", "c"]
    assert "3/3" in stream.getvalue()


def test_unknown_total_is_counted(monkeypatch):
    stream = TerminalDouble()
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setenv("TERM", "xterm")
    assert list(with_progress(iter("ab"), "frame")) == ["a", "b"]
    assert "2/?" in stream.getvalue()


def test_output_for_a_file_is_not_shown_on_the_terminal(monkeypatch):
    terminal, file = TerminalDouble(), io.StringIO()
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setattr(sys, "stdout", file)
    for figure in with_progress(["figure 1"], "topic"):
        print(figure)
    assert file.getvalue() == "figure 1\n"
    assert "figure 1" not in terminal.getvalue()


def test_duration_is_announced_on_a_terminal_only(monkeypatch):
    streams = TerminalDouble(), io.StringIO()
    for stream in streams:
        monkeypatch.setattr(sys, "stderr", stream)
        announce_duration("stepping", 60.0)
    terminal, pipe = (stream.getvalue() for stream in streams)
    assert terminal.startswith("stepping: 60 s, until ")
    assert pipe == ""
