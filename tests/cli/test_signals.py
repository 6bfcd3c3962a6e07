"""A signal ends commands cleanly, whatever they are doing."""

import os
import signal
import subprocess
import sys
import threading

import pytest

from app.cli.process import SIGNALS, note_signals, raise_signals
from app.report import write
from tests.cli.command import margin_table, run
from tests.cli.small_case import write_small_case
from tests.forking import COMMAND, forked, run_forked

pytestmark = pytest.mark.slow

both_signals = pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])

PUBLISHER = """
import sys
import threading
from std_msgs.msg import String
from app.bridge import RosNode
from app.bridge.heartbeat import Heartbeat
from app.bridge.topics import STREAM, Topic
from app.cli.process import note_signals

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


def test_signal_ends_publisher_cleanly_with_messages_in_flight(domain_id):
    with forked("-c", PUBLISHER) as process:
        assert process.stdout.readline() == "up\n"
        process.send_signal(signal.SIGTERM)
        assert process.communicate() == ("left\n", "")
        assert process.wait() == 128 + signal.SIGTERM


WHILE_A_FOLDER_IS_MADE = """
import os
import signal
import tempfile
import time
from pathlib import Path
from app.cli.process import raise_signals
from app.files.atomic_io import atomic_file

def interrupted(*arguments, make=tempfile.mkdtemp):
    path = make(*arguments)
    os.kill(os.getpid(), signal.SIGINT)
    return path

tempfile.mkdtemp = interrupted
try:
    with raise_signals(), atomic_file(Path("new")) as partial:
        print(partial.parent.is_dir())
        time.sleep(60.0)
except KeyboardInterrupt:
    print("interrupted")
"""


def test_signal_while_a_temporary_folder_is_made_leaves_none(tmp_path):
    done = run_forked("-c", WHILE_A_FOLDER_IS_MADE, folder=tmp_path)
    assert (done.stdout, [*tmp_path.iterdir()]) == ("True\ninterrupted\n", []), done.stderr


INTERRUPTED = """
import os
import signal
import sys

class Interrupt:
    # Ctrl-C while a library looks for a package that it can do without: what is raised is dropped.

    came = False

    def find_spec(self, name, path=None, target=None):
        if name in ("app.bridge", "app.synthetic"):
            sys.meta_path.remove(self)
            Interrupt.came = True
            try:
                os.kill(os.getpid(), signal.SIGINT)
            except BaseException:
                pass

from app.cli.main import main
sys.meta_path.insert(0, Interrupt())
status = main(sys.argv[1:])
print(Interrupt.came)
sys.exit(status)
"""


@pytest.mark.parametrize(
    ("command", "status"),
    [
        (["record", "-o", "new"], 130),
        (["serve"], 0),
        (["make-case", "new"], 130),  # which does not wait for a signal
    ],
)
def test_signal_during_import_ends_the_command(domain_id, tmp_path, command, status):
    done = run_forked("-c", INTERRUPTED, *command, folder=tmp_path)
    assert done.returncode == status, done.stderr
    assert done.stdout.endswith("True\n")
    if command[0] == "make-case":
        assert (done.stdout, done.stderr, [*tmp_path.iterdir()]) == ("True\n", "", [])


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
sys.exit(main(arguments))
"""


@pytest.mark.parametrize(
    ("number", "place", "command"),
    [
        (signal.SIGINT, "app.case.conversion.write_recording", "convert {case} new"),
        (signal.SIGTERM, "app.synthetic.writing.simulate", "make-case new"),
        (signal.SIGINT, "pathlib.Path.replace", "tumor {case}/tumor.stl --units mm -o new.stl"),
    ],
)
def test_signal_during_writing_leaves_no_partial_file(tmp_path, number, place, command):
    case, folder = write_small_case(tmp_path / "case"), tmp_path / "work"
    folder.mkdir()
    words = command.format(case=case).split()
    done = run_forked("-c", WRITING, int(number), place, *words, folder=folder)
    printed = [line for line in done.stderr.splitlines() if not line.startswith("compiling for")]
    assert (done.returncode, printed) == (128 + number, [])
    assert [*folder.iterdir()] == []


@both_signals
def test_recorded_signal_leaves_complete_case(domain_id, project_root, tmp_path, number):
    live = project_root / "data/live_example/live.yaml"
    record = ("record", "-o", "new", "--config", live)
    program = ("-c", WRITING, int(number), "app.case.new_case._write", *record)
    done = run_forked(*program, folder=tmp_path, modules=COMMAND)
    assert done.returncode == 128 + number, done.stderr
    assert (tmp_path / "new" / "case.yaml").is_file()
    assert [*tmp_path.rglob(".*")] == []


def test_recorded_signal_leaves_complete_report(tmp_path, monkeypatch, without_scene):
    write_files = write.write_files

    def interrupted(*arguments):
        signal.raise_signal(signal.SIGINT)
        write_files(*arguments)

    monkeypatch.setattr(write, "write_files", interrupted)
    case, report = write_small_case(tmp_path / "case"), tmp_path / "new"
    run("replay", case, "--no-ros", "--report", report, status=130)
    assert (report / "margin.csv").read_bytes() == margin_table(case)
    assert sorted(path.name for path in report.iterdir()) == [
        "analysis.json",
        "coverage.svg",
        "distances.svg",
        "margin.csv",
        "margin.png",
        "report.html",
        "summary.json",
    ]
    assert [*tmp_path.rglob(".*")] == []


def test_signal_during_compilation_ends_at_once(project_root, tmp_path):
    case = write_small_case(tmp_path / "case")
    with subprocess.Popen(
        [sys.executable, "-m", "app.cli", "replay", str(case), "--no-ros"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=project_root,
        env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "compiled")},
    ) as process:
        try:
            assert process.stderr.readline().startswith("compiling for this machine")
            process.send_signal(signal.SIGINT)
            assert process.communicate(timeout=120) == ("", "")
            assert process.returncode == 128 + signal.SIGINT
        finally:
            process.kill()
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
