"""State that survives a live session: its hold, also when it is killed at any moment."""

import os
import resource
import signal
import subprocess
import threading
from contextlib import ExitStack, contextmanager, suppress

import pytest

from app.hold import SecondInstanceError, StateFileError
from app.hold import on_disk as module
from app.hold.on_disk import RecordWriter, check_no_guard, live_state, lock_path, record_path
from app.hold.record import InstanceKey, read_record

pytestmark = pytest.mark.slow

KEY = InstanceKey("host", 7, "/", "touch /joint_states")
OTHER_ARM = InstanceKey("host", 7, "/", "other /joint_states")
OTHER_NAMESPACE = InstanceKey("host", 7, "/watch", "touch /joint_states")
OTHER_BOTH = InstanceKey("host", 7, "/watch", "other /joint_states")
HAND_HELD = InstanceKey("host", 7, "/hand", "")
NOW_NS = 1_700_000_000_000_000_000
DEADLINE_S = 60.0


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "state" / "marginguard"


def opened(folder, key=KEY, log=lambda line: None, now_ns=NOW_NS):
    return live_state(folder, key, {}, clock_ns=lambda: now_ns, log=log)


def record_of(folder, slot=KEY.slots[0]):
    return read_record(record_path(folder, slot), slot)


def run(folder, *, key=KEY, end=None, latched=None):
    """A run that begins, may latch a hold, may end in an orderly way; returns its start causes."""
    with opened(folder, key) as state:
        state.resume()
        if latched is not None:
            state.update(True, latched)
        if end is not None:
            state.end(*end)
        return state.start_causes


def test_first_start_has_no_hold_and_later_ones_after_an_orderly_end_neither(folder):
    assert run(folder, end=(False, ())) == ()
    assert run(folder, end=(False, ())) == ()


def test_run_that_did_not_end_holds_the_next_one(folder):
    assert run(folder) == ()
    (cause,) = run(folder)
    assert cause.startswith(f"guard restarted: the last run (process {os.getpid()}) ended without")


def test_hold_and_its_causes_survive_an_orderly_end_and_every_further_start(folder):
    run(folder, end=(True, ("stale",)), latched=("stale",))
    first, *earlier = run(folder, end=(True, ("guard restarted: x", "stale")))
    assert "ended on hold at" in first
    assert ", hold since " in first
    assert earlier == ["stale"]
    again, *earlier = run(folder)
    assert again.startswith("guard restarted")
    assert earlier == ["stale"]


def test_hold_that_began_earlier_keeps_its_time(folder):
    with opened(folder, now_ns=NOW_NS) as state:
        state.resume()
        state.update(True, ("stale",))
    with opened(folder, now_ns=NOW_NS + 10**12) as state:
        state.resume()
        state.update(True, (*state.start_causes, "missing"))
    assert record_of(folder).hold.since_ns == NOW_NS


def test_run_without_a_step_leaves_the_hold_as_it_was(folder):
    with opened(folder):
        pass
    assert record_of(folder).allows_start
    run(folder, latched=("stale",))
    with opened(folder):
        pass
    assert not record_of(folder).allows_start
    assert run(folder)[1:] == ("stale",)


def test_rearmed_run_is_still_running(folder):
    with opened(folder) as state:
        state.resume()
        state.update(True, ("stale",))
        state.update(False, ())
    record = record_of(folder)
    assert (record.hold, record.ended, record.allows_start) == (None, False, False)


def test_run_that_resumes_after_its_end_has_not_ended(folder):
    with opened(folder) as state:
        state.end(False)
        state.resume()
    assert not record_of(folder).allows_start


@pytest.mark.parametrize("key", [OTHER_ARM, OTHER_NAMESPACE])
def test_hold_belongs_to_the_namespace_and_to_the_arm(folder, key):
    run(folder, latched=("stale",))
    assert run(folder, key=key, end=(False, ()))[0].startswith("guard restarted")
    assert run(folder, key=HAND_HELD) == ()


@pytest.mark.parametrize("content", [b"", b"\x00\xff" * 40, b'{"version": 1, "key"'])
def test_damaged_record_holds_and_is_replaced(folder, content):
    run(folder, end=(False, ()))
    record_path(folder, KEY.slots[0]).write_bytes(content)
    (cause,) = run(folder, end=(True, ("x",)))
    assert cause.startswith("guard restarted: how the last run ended is not known: ")
    assert record_of(folder).ended


def test_clock_that_was_set_back_changes_nothing(folder):
    with opened(folder, now_ns=NOW_NS) as state:
        state.resume()
        state.update(True, ("stale",))
    with opened(folder, now_ns=0) as state:
        assert state.start_causes[0].startswith("guard restarted")
        state.end(False)
    assert run(folder) == ()


@pytest.mark.parametrize(("path", "done"), [(record_path, "written"), (lock_path, "locked")])
def test_folder_in_place_of_a_file_refuses_the_start(folder, path, done):
    path(folder, KEY.slots[0]).mkdir(parents=True)
    with pytest.raises(StateFileError, match=f"cannot be {done}: Is a directory"):
        run(folder)


def test_file_in_place_of_the_folder_refuses_the_start(folder):
    folder.parent.mkdir()
    folder.write_text("")
    with pytest.raises(StateFileError, match="expected a writable folder"):
        run(folder)


@pytest.mark.parametrize("key", [KEY, OTHER_ARM, OTHER_NAMESPACE])
def test_second_guard_of_a_namespace_or_an_arm_is_refused_and_named(folder, key):
    with (
        opened(folder),
        pytest.raises(SecondInstanceError, match=f"process {os.getpid()} .*; expected one guard"),
    ):
        run(folder, key=key)


def test_guard_of_another_namespace_and_another_arm_is_allowed(folder):
    with opened(folder):
        assert run(folder, key=OTHER_BOTH) == ()
        assert run(folder, key=HAND_HELD) == ()


def test_refused_guard_releases_what_it_has_locked(folder):
    with opened(folder, OTHER_NAMESPACE):
        with pytest.raises(SecondInstanceError):
            run(folder, key=KEY)
        assert run(folder, key=OTHER_ARM) == ()


def test_replay_is_refused_beside_a_guard_and_leaves_no_file(folder):
    slot = KEY.slots[0]
    check_no_guard(lock_path(folder, slot), slot)
    assert not folder.exists()
    with opened(folder) as state:
        state.end(False)
        with pytest.raises(SecondInstanceError):
            check_no_guard(lock_path(folder, slot), slot)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    check_no_guard(lock_path(folder, slot), slot)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    assert run(folder) == ()


def remove_files(folder):
    for path in folder.iterdir():
        path.unlink(missing_ok=True)  # a file that is being written gets another name


def wait_for_writer(state):
    """Wait until the writer has processed what was put, and has looked at the locks after it."""
    beats, beat = threading.Semaphore(0), state._beat

    def observed():
        beat()
        beats.release()

    state._writer._beat = observed
    for _ in range(2):  # the first one may have begun before
        assert beats.acquire(timeout=DEADLINE_S)
    state._writer._beat = beat


@pytest.mark.parametrize("steps", [False, True], ids=["before the first step", "after the steps"])
def test_files_removed_while_no_steps_are_taken_say_that_the_run_has_not_ended(
    folder, monkeypatch, steps
):
    monkeypatch.setattr("app.hold.on_disk.BEAT_S", 0.01)
    with opened(folder) as state:
        if steps:
            state.resume()
            state.end(False)
        remove_files(folder)
        wait_for_writer(state)
        assert not record_of(folder).allows_start
        state.end(False)
    assert record_of(folder).allows_start


def test_record_says_that_the_run_has_not_ended_until_it_is_closed(folder, monkeypatch):
    monkeypatch.setattr("app.hold.on_disk.BEAT_S", 0.01)
    with opened(folder) as state:
        state.end(True, ("stale",))
        state.end(False)
        wait_for_writer(state)
        assert not record_of(folder).ended
        record_path(folder, KEY.slots[0]).unlink()
        state.resume()
        wait_for_writer(state)
        assert not record_of(folder).ended
        state.end(False)
    assert record_of(folder).ended


def test_removed_files_are_locked_and_written_again(folder, monkeypatch):
    monkeypatch.setattr("app.hold.on_disk.BEAT_S", 0.01)
    with opened(folder) as state:
        state.resume()
        remove_files(folder)
        state.update(True, ("stale",))
        wait_for_writer(state)
        with pytest.raises(SecondInstanceError):
            run(folder)
    assert not record_of(folder).allows_start
    assert state.problem == ""


def test_update_does_not_wait_for_the_disk_and_the_newest_record_wins(folder, monkeypatch):
    blocked, written = threading.Event(), []
    write = module.write_durably

    def slow(path, content, error):
        if threading.current_thread().name == "hold record":
            assert blocked.wait(DEADLINE_S)
            written.append(path)
        write(path, content, error)

    monkeypatch.setattr(module, "write_durably", slow)
    with opened(folder, HAND_HELD) as state:
        for number in range(1000):
            state.update(True, (f"cause {number}",))  # returns although no write has returned
        blocked.set()
        state.end(True, ("last",))
    assert len(written) <= 3
    assert record_of(folder, HAND_HELD.slots[0]).hold.causes == ("last",)


def test_failed_write_is_logged_once_and_the_next_start_is_on_hold(folder, monkeypatch):
    lines = []
    with opened(folder, log=lines.append) as state:
        state.resume()

        def full(path, content, error):
            raise StateFileError("No space left on device")

        monkeypatch.setattr(module, "write_durably", full)
        for number in range(50):
            state.update(True, (f"cause {number}",))
        state.end(False)
    monkeypatch.undo()
    assert len(lines) == 1
    assert "No space left on device; a restart will begin on hold" in lines[0]
    assert run(folder)[0].startswith("guard restarted: the last run")


def test_writer_gives_up_on_a_disk_that_does_not_answer(monkeypatch):
    monkeypatch.setattr("app.hold.on_disk._CLOSE_S", 0.05)
    answer = threading.Event()
    writer = RecordWriter(lambda record: answer.wait(DEADLINE_S), lambda: None, print)
    assert writer.close("last") is False
    answer.set()


@pytest.fixture(params=["small file system", "limited file size"])
def full_disk(request, tmp_path):
    """A folder, and ``full()``: a context in which nothing can be written to its disk."""
    if request.param == "limited file size":
        yield tmp_path / "state", no_file_may_grow
        return
    mount = ["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(tmp_path)]
    if os.geteuid() != 0 or subprocess.run(mount, check=False).returncode:
        pytest.skip("this user cannot mount a file system")

    @contextmanager
    def full():
        with suppress(OSError), (tmp_path / "filler").open("wb", buffering=0) as file:
            while True:
                file.write(b"\0" * 4096)
        yield

    yield tmp_path / "state", full
    subprocess.run(["umount", str(tmp_path)], check=True)


@contextmanager
def no_file_may_grow():
    """Not longer than necessary: the output of the tests may be a file, too."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    before = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        signal.signal(signal.SIGXFSZ, before)


def test_full_disk_refuses_a_start_and_keeps_the_hold_of_a_session_that_runs(full_disk):
    folder, full = full_disk
    lines = []
    with ExitStack() as later:
        with opened(folder, log=lines.append) as state:
            state.resume()
            wait_for_writer(state)  # a record that it replaces later would leave room on the disk
            later.enter_context(full())
            state.update(True, ("stale",))
            state.end(False)
        with pytest.raises(StateFileError, match=r"cannot be (written|locked)"):
            run(folder)
    assert len(lines) == 1
    assert "cannot be written" in lines[0]
    assert not record_of(folder).allows_start
