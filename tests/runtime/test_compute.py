"""Calls in another process: results, errors, and the end of either process."""

import os
import signal
import subprocess
import sys
import threading
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from app.fixture import ProximityEngine, prepared_tumor
from app.geometry import InputError, MeshError, SurfaceMesh, Transform
from app.runtime import ComputeProcess
from app.runtime.compute import read_object, write_object
from tests.fixture_shapes import tool, tumor
from tests.waiting import wait_until

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def process():
    with ComputeProcess() as made:
        yield made


def test_object_is_the_same_after_the_memory_file():
    arrays = [np.arange(7.0), np.empty((0, 3)), np.asfortranarray(np.ones((3, 5), np.float32))]

    file = write_object((arrays, "text"))
    try:
        read, text = read_object(file)
    finally:
        os.close(file)

    assert text == "text"
    for before, after in zip(arrays, read, strict=True):
        np.testing.assert_array_equal(before, after)
        assert after.flags.writeable and after.flags.aligned
    read[0][0] = 5.0  # a private copy


def test_tumour_prepared_in_another_process_gives_the_same_distances(process):
    surface = tumor("lobed", 3)
    engine = ProximityEngine(tumor("ball", 2), tool("needle"))
    poses = [
        Transform("tumor", "tool", np.eye(3), np.array([x, 1.0, 2.0])) for x in (-14.0, 3.0, 11.0)
    ]

    here = engine.with_tumor(prepared_tumor(surface))
    there = engine.with_tumor(process.call(prepared_tumor, surface))

    for pose in poses:
        assert here.evaluate(pose).signed_distance_mm == there.evaluate(pose).signed_distance_mm


def test_error_of_the_function_is_raised_here(process):
    surface = tumor("ball", 1)
    open_mesh = SurfaceMesh("tumor", surface.vertices_mm, surface.faces[:-1])

    with pytest.raises(MeshError, match="is not closed"):
        process.call(prepared_tumor, open_mesh)
    with pytest.raises(RuntimeError, match="ZeroDivisionError"):
        process.call(divmod, 1, 0)

    assert process.call(divmod, 7, 2) == (3, 1)


def test_killed_process_is_an_error_and_the_next_call_starts_another(process):
    first = process.call(os.getpid)

    with pytest.raises(InputError, match=r"ended with status -9; .*nothing has\s+changed"):
        process.call(os.kill, first, signal.SIGKILL)

    assert process.call(os.getpid) != first


def test_process_has_a_lower_priority(process):
    assert process.call(os.nice, 0) > os.nice(0)


def test_process_starts_with_the_first_call():
    before = children()
    with ComputeProcess() as made:
        assert children() == before

        pid = made.call(os.getpid)

        assert children() - before == {pid}


def test_process_that_starts_later_loads_before_the_first_call(tmp_path):
    before, loaded = children(), tmp_path / "loaded"
    with ComputeProcess() as made:
        made.start_after(0.0, partial(Path.touch, loaded))
        wait_until(loaded.exists)
        (started,) = children() - before

        assert started > 0


def test_process_loads_only_while_a_processor_is_idle(tmp_path):
    with ComputeProcess() as made:
        made.start_after(0.0, partial(write_scheduler, tmp_path / "scheduler"))
        wait_until(lambda: (tmp_path / "scheduler").exists())

        assert (tmp_path / "scheduler").read_text() == str(os.SCHED_IDLE)
        assert made.call(os.sched_getscheduler, 0) == os.SCHED_OTHER


def test_call_does_not_wait_for_a_process_that_is_loading(tmp_path):
    with ComputeProcess() as made:
        made.start_after(0.0, partial(write_pid_and_wait, tmp_path / "pid"))
        wait_until(lambda: (tmp_path / "pid").exists())

        pid = made.call(os.getpid)

        assert pid != int((tmp_path / "pid").read_text())
        assert made.call(os.getpid) == pid


def test_failure_to_load_does_not_affect_a_call(caplog):
    with ComputeProcess() as made:
        made.start_after(0.0, partial(divmod, 1, 0))
        wait_until(lambda: "ZeroDivisionError" in caplog.text)

        assert "computing process: not loaded: ZeroDivisionError" in caplog.text
        assert made.call(divmod, 7, 2) == (3, 1)


def test_closed_process_does_not_start_later():
    before = children()
    process = ComputeProcess()
    process.start_after(3600.0, os.getpid)

    process.close()

    assert children() == before
    assert not [each for each in threading.enumerate() if isinstance(each, threading.Timer)]


def test_closed_process_refuses_calls():
    process = ComputeProcess()
    process.close()

    with pytest.raises(InputError, match="is closed"):
        process.call(os.getpid)


def test_process_ends_when_its_starter_is_killed(project_root):
    code = (
        "import os, time; from app.runtime import ComputeProcess\n"
        "made = ComputeProcess(); print(made.call(os.getpid), flush=True); time.sleep(600)"
    )
    starter = subprocess.Popen(
        [sys.executable, "-c", code],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(project_root)},
    )
    with starter:
        pid = int(starter.stdout.readline())
        starter.kill()
    wait_until(lambda: not is_running(pid))


def write_scheduler(path):
    """Write the scheduling policy of this thread."""
    write(path, os.sched_getscheduler(0))


def write_pid_and_wait(path):
    """Load for very long."""
    write(path, os.getpid())
    time.sleep(600.0)


def write(path, value):
    """Write a number at once."""
    path.with_suffix(".part").write_text(str(value))
    path.with_suffix(".part").rename(path)


def is_running(pid):
    """True for a process that has not ended; a zombie of another parent has."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] not in "ZX"
    except FileNotFoundError:
        return False


def children():
    """The processes that this one has started (proc(5))."""
    found = set()
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = path.read_text().rsplit(")", 1)[1].split()[1]
        except OSError:
            continue  # it has just ended
        if int(parent) == os.getpid():
            found.add(int(path.parent.name))
    return found
