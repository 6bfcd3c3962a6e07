"""A signal ends commands cleanly, whatever they are doing."""

import os
import signal
import subprocess
import sys
import threading

import pytest

from app.cli.signals import SIGNALS, note_signals, raise_signals
from tests.cli.small_case import write_small_case
from tests.ros_domain import domain_id as domain_id

PUBLISHER = """
import sys
import threading
from std_msgs.msg import String
from app.bridge import RosNode
from app.bridge.heartbeat import Heartbeat
from app.bridge.qos import STREAM, Topic
from app.cli.signals import note_signals

over = threading.Event()
with note_signals() as received, RosNode("publisher") as ros:
    received.stops(over.set)
    publisher = ros.publisher(Topic("~/messages", String, STREAM))
    heartbeat = Heartbeat(lambda text, seq: publisher.publish(String(data=f"{text} {seq}")), 500.0)
    heartbeat.update("beat")
    print("up", flush=True)
    over.wait()
    heartbeat.close()
print("left", flush=True)
sys.exit(received.exit_status)
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signal_ends_publisher_cleanly_with_messages_in_flight(domain_id, project_root, number):
    process = subprocess.Popen(
        [sys.executable, "-c", PUBLISHER],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=project_root,
    )
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "up\n"
        process.send_signal(number)
        assert process.stdout.read() == "left\n"
        assert process.stderr is not None
        assert process.stderr.read() == ""
        assert process.wait(30) == 128 + number
    finally:
        process.kill()
        process.wait()


INTERRUPTED = """
import os
import signal
import sys

class Interrupt:
    # Ctrl-C while a library looks for a package that it can do without: what is raised is dropped.

    came = False

    def find_spec(self, name, path=None, target=None):
        if name == "numpy.linalg":
            sys.meta_path.remove(self)
            Interrupt.came = True
            try:
                os.kill(os.getpid(), signal.SIGINT)
            except BaseException:
                pass

from app.cli.main import main
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's "&" has it ignored
sys.meta_path.insert(0, Interrupt())
status = main(sys.argv[1:])
print(Interrupt.came)
sys.exit(status)
"""


@pytest.mark.parametrize("command", [["record", "-o", "new"], ["igtl"], ["serve"]])
def test_signal_during_import_is_not_lost(domain_id, project_root, tmp_path, command):
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED, *command],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(project_root)},
        timeout=120,
    )
    assert done.returncode == (0 if command == ["serve"] else 130), done.stderr
    assert done.stdout.endswith("True\n")


def test_signal_during_import_ends_command_that_does_not_wait(project_root, tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED, "make-case", "new"],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(project_root)},
        timeout=120,
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, "True\n", "")
    assert [*tmp_path.iterdir()] == []


WRITING = """
import os
import pkgutil
import signal
import sys

number, place, *arguments = sys.argv[1:]
within, _, name = place.rpartition(".")
writing = pkgutil.resolve_name(within)
write = getattr(writing, name)

def interrupted(*args, **kwargs):
    os.kill(os.getpid(), int(number))
    return write(*args, **kwargs)

setattr(writing, name, interrupted)
from app.cli.main import main
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's "&" has it ignored
sys.exit(main(arguments))
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize(
    ("place", "command"),
    [
        ("app.case.convert.write_recording", "convert {case} new"),
        ("app.synthetic.writing.simulate", "make-case new"),
        ("pathlib.Path.replace", "tumor {case}/tumor.stl --units mm -o new.stl"),
    ],
)
def test_signal_during_writing_leaves_no_partial_file(
    project_root, tmp_path, number, place, command
):
    case, folder = write_small_case(tmp_path / "case"), tmp_path / "work"
    folder.mkdir()
    done = subprocess.run(
        [
            sys.executable,
            "-c",
            WRITING,
            str(int(number)),
            place,
            *command.format(case=case).split(),
        ],
        capture_output=True,
        text=True,
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(project_root)},
        timeout=120,
    )
    printed = [line for line in done.stderr.splitlines() if not line.startswith("compiling for")]
    assert (done.returncode, printed) == (128 + number, [])
    assert [*folder.iterdir()] == []


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize(
    ("place", "command", "whole"),
    [
        ("app.report.write.write_files", "replay {case} --no-ros --report new", "report.html"),
        ("app.case.live_recording._write", "record -o new --config {live}", "case.yaml"),
    ],
)
def test_recorded_signal_leaves_complete_file(
    domain_id, project_root, tmp_path, number, place, command, whole
):
    case = write_small_case(tmp_path / "case")
    live = project_root / "data/live_example/live.yaml"
    done = subprocess.run(
        [
            *(sys.executable, "-c", WRITING, str(int(number)), place),
            *command.format(case=case, live=live).split(),
        ],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(project_root)},
        timeout=120,
    )
    assert done.returncode == 128 + number, done.stderr
    assert (tmp_path / "new" / whole).is_file()
    assert [*tmp_path.rglob(".*")] == []


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signal_during_compilation_ends_at_once(project_root, tmp_path, number):
    case = write_small_case(tmp_path / "case")
    process = subprocess.Popen(
        [sys.executable, "-m", "app.cli", "replay", str(case), "--no-ros"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=project_root,
        env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "compiled")},
    )
    try:
        assert process.stderr is not None
        assert process.stderr.readline().startswith("compiling for this machine")
        process.send_signal(number)
        assert process.communicate(timeout=120) == ("", "")
        assert process.returncode == 128 + number
    finally:
        process.kill()
        process.wait()
    assert [*tmp_path.rglob("measure*.nbi")] == [], "the compiler was not waited for"


def test_previous_handlers_are_restored():
    before = {number: signal.getsignal(number) for number in SIGNALS}
    with raise_signals(), note_signals() as received:
        assert all(signal.getsignal(number) != before[number] for number in SIGNALS)
    assert {number: signal.getsignal(number) for number in SIGNALS} == before
    assert received.exit_status == 0


def test_signal_calls_stop_and_raises_nothing():
    stopped = threading.Event()
    with note_signals() as received:
        received.stops(stopped.set)
        signal.raise_signal(signal.SIGINT)
        assert stopped.wait(30.0)
    assert received.exit_status == 130


def test_early_signal_calls_later_stop_function():
    noted, stopped = threading.Event(), threading.Event()
    with note_signals() as received:
        received.stops(noted.set)
        signal.raise_signal(signal.SIGTERM)
        assert noted.wait(30.0)
        received.stops(stopped.set)
    assert stopped.is_set()
    assert received.exit_status == 143
