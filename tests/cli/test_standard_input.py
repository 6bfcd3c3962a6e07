"""A command that waits for standard input in a thread ends with its own status."""

import signal
import subprocess
import sys

import pytest

from tests.ros_domain import domain_id as domain_id

WAITS = """
import sys, threading
from app.cli.standard_input import standard_input

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


def test_process_ends_while_a_thread_waits_for_standard_input(project_root):
    process = subprocess.Popen(
        [sys.executable, "-c", WAITS],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        cwd=project_root,
    )
    try:
        process.stdin.write(b"a line\n")
        process.stdin.flush()
        assert process.stdout.read() == b"a line\n"
        assert process.stderr.read() == b""
        assert process.wait(60) == 3
    finally:
        process.kill()
        process.wait()


@pytest.mark.parametrize("command", ["record", "operation"])
def test_signal_ends_a_command_whose_input_is_open(domain_id, project_root, tmp_path, command):
    new = str(tmp_path / "new")
    arguments = {"record": ["-o", new, "--until-eof", "--json"], "operation": [new]}[command]
    process = subprocess.Popen(
        [sys.executable, "-m", "app.cli", command, *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        cwd=project_root,
    )
    try:
        while b"status" not in (line := process.stdout.readline()) and new.encode() not in line:
            assert line
        process.send_signal(signal.SIGINT)
        process.stdout.read()
        process.stderr.read()
        assert process.wait(60) == 130
    finally:
        process.kill()
        process.wait()
