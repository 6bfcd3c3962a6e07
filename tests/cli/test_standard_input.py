"""A command ends with its own status, also when a thread waits for standard input."""

import signal

import pytest

from tests.forking import COMMAND, forked

pytestmark = pytest.mark.slow

WAITS = """
import atexit, sys, threading
from concurrent.futures import ThreadPoolExecutor
from app.cli.process import leave

class Library:
    def __del__(self):
        print("teardown", flush=True)

library, reached = Library(), threading.Event()

def read():
    stream = sys.stdin.buffer
    print(stream.readline().decode(), end="", flush=True)
    reached.set()
    stream.readline()

threading.Thread(target=read, daemon=True).start()
reached.wait()
atexit.register(print, "registered")
ThreadPoolExecutor().submit(print, "computed")
leave(3)
"""


def test_process_ends_as_an_interpreter_but_without_teardown():
    with forked("-c", WAITS) as process:
        process.stdin.write("a line\n")
        process.stdin.flush()
        assert process.wait() == 3
        assert process.stdout.read() == "a line\ncomputed\nregistered\n"
        assert process.stderr.read() == ""


@pytest.mark.parametrize("command", ["record --until-eof --json -o", "simulate operation"])
def test_signal_ends_a_command_whose_input_is_open(domain_id, tmp_path, command):
    new = str(tmp_path / "new")
    with forked("-m", "app.cli", *command.split(), new, modules=COMMAND) as process:
        while "status" not in (line := process.stdout.readline()) and new not in line:
            assert line
        process.send_signal(signal.SIGINT)
        assert process.wait() == 130
