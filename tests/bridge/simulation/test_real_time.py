"""The pace of a world along a clock of the test."""

import threading

import pytest

from app.bridge.simulation import RealTime
from app.bridge.simulation.real_time import MAX_LAG_NS
from app.geometry import NS_PER_MS, NS_PER_S
from app.simulation import ArmStatus, JointVelocityCommand, World, open_world

pytestmark = pytest.mark.slow

HOST_NS = 1_700_000_000 * NS_PER_S


@pytest.fixture
def world(project_root):
    return World(open_world(project_root / "data" / "worlds" / "lumpectomy"))


class ClockDouble:
    """A clock that moves when somebody waits, and by ``busy_ns`` with each step."""

    def __init__(self):
        self.now_ns, self.busy_ns = 5 * NS_PER_S, 0

    def wait(self, seconds):
        self.now_ns += max(1, round(seconds * NS_PER_S))


class Recorder:
    """Steps the world and records the stamps; ends after ``count`` steps."""

    def __init__(self, clock, stop, count, *, each=lambda number: None):
        self.stamps, self.times, self.reports, self.idles = [], [], [], 0
        self._clock, self._stop, self._count, self._each = clock, stop, count, each

    def step(self, world, now_ns):
        self._clock.now_ns += self._clock.busy_ns
        return world.step()

    def publish(self, state, stamp_ns):
        self.times.append(state.time_ns)
        self.stamps.append(stamp_ns)
        self._each(len(self.stamps))
        if len(self.stamps) == self._count:
            self._stop.set()

    def idle(self):
        self.idles += 1

    def report(self, real_time_factor, lags):
        self.reports.append((real_time_factor, lags))


@pytest.fixture
def clock():
    return ClockDouble()


@pytest.fixture
def pace(world, clock):
    return RealTime(world, clock_ns=lambda: clock.now_ns, host_ns=lambda: HOST_NS, wait=clock.wait)


def run(pace, clock, count, **arguments):
    stop = threading.Event()
    recorder = Recorder(clock, stop, count, **arguments)
    pace.run(recorder, stop)
    return recorder


def test_states_have_the_host_time_at_which_they_are_due(pace, clock):
    begin_ns = clock.now_ns
    recorder = run(pace, clock, 3000)
    assert recorder.stamps == [HOST_NS + n * NS_PER_MS for n in range(1, 3001)]
    assert clock.now_ns - begin_ns == pytest.approx(3 * NS_PER_S, abs=NS_PER_MS)
    assert len(recorder.reports) == 3
    for factor, lags in recorder.reports:
        assert factor == pytest.approx(1.0, abs=0.01)
        assert lags == 0


def test_physics_that_falls_behind_stops_the_arms_and_goes_on_later(pace, clock, world):
    joints = world.state().arms["arm"].joints
    world.step({"arm": JointVelocityCommand(0, joints, (0.1,) * 6)})
    assert world.state().arms["arm"].is_busy

    def each(number):
        clock.now_ns += MAX_LAG_NS + 2 * NS_PER_MS if number == 10 else 0

    recorder = run(pace, clock, 100, each=each)
    assert pace.lags == 1
    arm = world.state().arms["arm"]
    assert arm.status is ArmStatus.FAULT
    assert arm.fault == "the physics was 32 ms behind real time"
    gaps = [b - a for a, b in zip(recorder.stamps, recorder.stamps[1:], strict=False)]
    assert sorted(set(gaps)) == [NS_PER_MS, 33 * NS_PER_MS]


def test_slow_physics_is_reported_as_it_is(pace, clock):
    clock.busy_ns = 4 * NS_PER_MS
    recorder = run(pace, clock, 1000)
    assert recorder.reports
    for factor, lags in recorder.reports:
        assert factor == pytest.approx(0.25, abs=0.01)
        assert lags > 10


def test_pause_single_step_and_resume_keep_the_simulated_time(pace, clock, world):
    pace.pause()
    paused = threading.Event()
    waits = []

    def wait(seconds):
        clock.wait(seconds)
        waits.append(world.time_ns)
        if len(waits) == 5:
            pace.step_once()
        elif len(waits) == 20:
            paused.set()
            pace.resume()

    pace._wait = wait
    recorder = run(pace, clock, 11)
    assert waits[:5] == [0] * 5
    assert waits[6:20] == [NS_PER_MS] * 14
    assert recorder.idles >= 18
    assert recorder.times == [n * NS_PER_MS for n in range(1, 12)]
    # The pause lies between the stamps, and states after it are in step with the clock again.
    assert recorder.stamps[1] - recorder.stamps[0] >= 14 * NS_PER_MS
    assert pace.lags == 0


def test_reset_begins_again_while_host_time_goes_on(pace, clock, world):
    recorder = run(pace, clock, 50, each=lambda number: pace.reset() if number == 20 else None)
    assert recorder.times == [n * NS_PER_MS for n in (*range(1, 21), *range(1, 31))]
    assert all(b > a for a, b in zip(recorder.stamps, recorder.stamps[1:], strict=False))
