"""Keys of a terminal; the terminal is a real one, made by the kernel."""

import os
import pty
import queue
import sys
import termios

import pytest

from app.cli.simulated_hand import pressed_keys
from app.geometry import InputError


def test_keys_arrive_one_by_one_and_the_terminal_is_restored(monkeypatch):
    ours, theirs = pty.openpty()
    with os.fdopen(theirs) as terminal:
        monkeypatch.setattr(sys, "stdin", terminal)
        before = termios.tcgetattr(theirs)
        keys = queue.Queue()
        with pressed_keys(keys.put):
            assert termios.tcgetattr(theirs) != before
            os.write(ours, b"wa ")
            assert [keys.get(timeout=60) for _ in range(3)] == ["w", "a", " "]
        assert termios.tcgetattr(theirs) == before
    os.close(ours)


def test_input_that_is_no_terminal_is_refused(monkeypatch, tmp_path):
    file = tmp_path / "input"
    file.write_text("w")
    with file.open() as given:
        monkeypatch.setattr(sys, "stdin", given)
        with (
            pytest.raises(InputError, match="the standard input is no terminal; expected one"),
            pressed_keys(print),
        ):
            pass
