"""A process that is killed at random moments never leaves a record that allows a start."""

import os
import random
import signal
import time

import pytest

from app.hold.on_disk import live_state
from app.hold.record import InstanceKey

pytestmark = pytest.mark.long

KEY = InstanceKey("host", 7, "/", "touch /joint_states")
KILLS = 30
MAX_LIFE_S = 0.02
"""About two runs of a guard, each of up to 20 changes."""


def run(folder, report):
    """Runs of a guard one after the other: held, re-armed and ended in turn, without a pause.

    Reports a byte when an orderly end without hold begins, and one when another run has started.
    """
    while True:
        with live_state(folder, KEY, {}, clock_ns=time.time_ns, log=print) as state:
            os.write(report, b"+")
            state.resume()
            for number in range(random.randrange(20)):
                state.update(number % 3 == 0, (f"cause {number}",))
                time.sleep(random.uniform(0.0, 0.002))
            os.write(report, b"-")
            state.end(False)


@pytest.mark.parametrize("seed", [1, 2])
def test_only_an_orderly_end_allows_a_start(tmp_path, seed):
    folder, kill = tmp_path / "state", random.Random(seed)
    allowed = held = 0
    for _ in range(KILLS):
        reader, writer = os.pipe()
        child = os.fork()
        if child == 0:
            try:
                random.seed(kill.random())
                run(folder, writer)
            finally:
                os._exit(1)
        os.close(writer)
        assert os.read(reader, 1) == b"+"  # it is running: the first record is on the disk
        time.sleep(kill.uniform(0.0, MAX_LIFE_S))
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        last = b"+"
        while rest := os.read(reader, 4096):
            last = rest[-1:]
        os.close(reader)
        with live_state(folder, KEY, {}, clock_ns=time.time_ns, log=print) as state:
            causes = state.start_causes  # also: the lock of the killed process is free
            state.resume()
            state.end(False)
        if last == b"+":
            assert causes, "killed while it ran"
            held += 1
        elif not causes:
            allowed += 1  # killed after its orderly end, before the next one was reported
    assert held >= KILLS // 10
    assert allowed + held <= KILLS
