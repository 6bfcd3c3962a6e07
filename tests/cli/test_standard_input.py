"""A command that waits for standard input in a thread ends with its own status."""

import signal

import pytest

from tests.forking import COMMAND, forked

pytestmark = pytest.mark.slow

WAITS = """
import sys, threading
from app.cli.process import standard_input

reached = threading.Event()

def read():
    stream = standard_input()
    print(stream.readline().decode(), end="", flush=True)
    reached.set()
    stream.readline()

threading.Thread(target=read, daemon=True).start()
reached.wait()
sys.exit(3)
"""


def test_process_ends_while_a_thread_waits_for_standard_input():
    with forked("-c", WAITS) as process:
        process.stdin.write("a line\n")
        process.stdin.flush()
        assert process.wait() == 3
        assert process.stdout.read() == "a line\n"
        assert process.stderr.read() == ""


@pytest.mark.parametrize("command", ["record --until-eof --json -o", "simulate operation"])
def test_signal_ends_a_command_whose_input_is_open(domain_id, tmp_path, command):
    new = str(tmp_path / "new")
    with forked("-m", "app.cli", *command.split(), new, modules=COMMAND) as process:
        while "status" not in (line := process.stdout.readline()) and new not in line:
            assert line
        process.send_signal(signal.SIGINT)
        assert process.wait() == 130
