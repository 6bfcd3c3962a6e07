"""Qt's thread is woken by other threads, in loops that release Python's lock and that keep it."""

import threading
from pathlib import Path
from types import SimpleNamespace

import pytest

pytest.importorskip(
    "PySide6.QtCore", reason="PySide6 cannot be loaded: apt install libegl1", exc_type=ImportError
)

from PySide6 import QtCore

from app.runtime.thread_handover import QtSpinner, keeps_interpreter_lock
from benchmarks.latency.qt_loops import LOOPS, quit_loop
from tests.slicer_module.desktop import desktop_slicer

pytestmark = pytest.mark.slow

NEVER_MS = 3_600_000
FEW_MS = 50


@pytest.fixture(scope="module", autouse=True)
def application():
    with desktop_slicer():
        yield


@pytest.fixture(params=LOOPS)
def loop(request):
    run, keeps_lock = LOOPS[request.param]
    return SimpleNamespace(run=run, keeps_lock=keeps_lock)


@pytest.fixture
def spinner(loop):
    """``spinner(spin)`` makes one without a watchdog, for the kind of loop of this test."""
    made = []

    def make(spin, watchdog_ms=NEVER_MS):
        made.append(QtSpinner(QtCore, spin, keeps_lock=loop.keeps_lock, watchdog_ms=watchdog_ms))
        return made[-1]

    yield make
    for each in made:
        each.stop()


def in_thread(work):
    thread = threading.Thread(target=work)
    thread.start()
    return thread


def descriptors():
    return sorted(path.name for path in Path("/proc/self/fd").iterdir())


def test_other_thread_wakes_the_loop_without_a_timer(loop, spinner):
    threads, main = [], threading.current_thread()

    def spin():
        threads.append(threading.current_thread())
        quit_loop()

    woken = spinner(spin)
    begin = threading.Event()
    sender = in_thread(lambda: (begin.wait(), woken.wake()))
    QtCore.QTimer.singleShot(0, begin.set)  # while the loop runs
    loop.run()
    sender.join()
    assert threads == [main]


def test_thread_that_sends_one_message_after_another_is_received_at_once(loop, spinner):
    """Every message is sent after the one before was received: a ping-pong without a timer."""
    count, received = 20, threading.Semaphore(0)
    sent, seen = [], []

    def spin():
        seen.append(len(sent))
        if len(seen) == count:
            quit_loop()
        received.release()

    woken = spinner(spin)

    def send():
        for number in range(count):
            sent.append(number)
            woken.wake()
            received.acquire()

    sender = in_thread(send)
    loop.run()
    sender.join()
    assert seen == list(range(1, count + 1))


def test_many_messages_are_one_call(loop, spinner):
    calls = []
    woken = spinner(lambda: calls.append(None))
    in_thread(lambda: [woken.wake() for _ in range(1000)]).join()
    loop.run(FEW_MS)
    assert len(calls) == 1


def test_threads_that_wake_at_the_same_time_lose_no_message(loop, spinner):
    total, threads = 2000, 4
    lock, waiting, taken = threading.Lock(), [], []

    def spin():
        with lock:
            taken.extend(waiting)
            waiting.clear()
        if len(taken) == total * threads:
            quit_loop()

    woken = spinner(spin)

    def send():
        for number in range(total):
            with lock:
                waiting.append(number)
            woken.wake()

    senders = [in_thread(send) for _ in range(threads)]
    loop.run()
    for sender in senders:
        sender.join()
    assert len(taken) == total * threads


@pytest.mark.parametrize("error", ["", "a bug in a handler"])
def test_message_that_comes_during_a_call_is_followed_by_another_call(loop, spinner, capsys, error):
    calls = []

    def spin():
        calls.append(None)
        if len(calls) == 1:
            in_thread(woken.wake).join()
            if error:
                raise ValueError(error)
        else:
            quit_loop()

    woken = spinner(spin)
    woken.wake()
    loop.run()
    assert len(calls) == 2
    assert error in capsys.readouterr().err


def test_call_that_runs_the_loop_itself_is_not_called_within(loop, spinner):
    depths, depth = [], 0

    def spin():
        nonlocal depth
        depth += 1
        depths.append(depth)
        if len(depths) == 1:
            woken.wake()
            for _ in range(5):
                QtCore.QCoreApplication.processEvents()
        else:
            quit_loop()
        depth -= 1

    woken = spinner(spin)
    woken.wake()
    loop.run()
    assert depths == [1, 1]


def test_watchdog_calls_without_a_message(loop, spinner):
    calls = []

    def spin():
        calls.append(None)
        if len(calls) == 3:
            quit_loop()

    spinner(spin, watchdog_ms=1)
    loop.run()
    assert len(calls) == 3


def test_no_call_after_stop_and_no_descriptor_stays_open(loop, spinner):
    spinner(lambda: None).stop()  # Qt opens some of its own at the first
    before = descriptors()
    calls = []
    made = [spinner(lambda: calls.append(None), watchdog_ms=1) for _ in range(20)]
    assert len(descriptors()) > len(before)
    for each in made:
        each.wake()
        each.stop()
        each.stop()
        in_thread(each.wake).join()
    loop.run(FEW_MS)
    assert calls == []
    assert descriptors() == before


def test_one_of_two_wakes_the_other_one_which_waits(loop, spinner):
    """Both panels have one each: the wait for one ends when data for the other one arrive."""
    idle = spinner(lambda: None)
    woken = spinner(quit_loop)
    begin = threading.Event()
    sender = in_thread(lambda: (begin.wait(), woken.wake()))
    QtCore.QTimer.singleShot(0, begin.set)
    loop.run()
    sender.join()
    assert not idle._wakeup.wait(0.0)


def test_binding_that_is_not_known_is_assumed_to_keep_the_lock():
    assert not keeps_interpreter_lock(QtCore)
    pythonqt = SimpleNamespace(QTimer=type("QTimer", (), {"__module__": "PythonQt.QtCore"}))
    assert keeps_interpreter_lock(pythonqt)
