import threading
from collections.abc import Callable, Iterator
from functools import partial

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.case import Player, TrackingFrame
from app.geometry import InputError, Stamp

MS = 1_000_000


class Time:
    """A clock that advances only while waiting; ``at`` schedules actions."""

    def __init__(self) -> None:
        self.ns = 5_000 * MS
        self._actions: list[tuple[int, Callable[[], None]]] = []

    def at(self, ms: int, action: Callable[[], None]) -> None:
        self._actions.append((5_000 * MS + ms * MS, action))
        self._actions.sort(key=lambda entry: entry[0])

    def clock_ns(self) -> int:
        return self.ns

    def wait(self, event: threading.Event, timeout_s: float | None) -> None:
        until = None if timeout_s is None else self.ns + round(timeout_s * 1e9)
        if self._actions and (until is None or self._actions[0][0] <= until):
            due, action = self._actions.pop(0)
            self.ns = max(self.ns, due)
            action()
        elif until is None:
            raise AssertionError("the player waits for ever")
        else:
            self.ns = until


def frames(*stamps_ms: int) -> Callable[[], Iterator[TrackingFrame]]:
    return lambda: (TrackingFrame(Stamp(ms * MS), ()) for ms in stamps_ms)


def played(player: Player, time: Time, *, limit: int = 1000) -> list[tuple[int, int]]:
    """(clock in ms since the start, stamp in ms) of each played frame."""
    found = []
    for frame in player.play():
        assert player.time_ns == frame.stamp.ns
        found.append(((time.ns - 5_000 * MS) // MS, frame.stamp.ns // MS))
        if len(found) == limit:
            break
    return found


def make(source: Callable[[], Iterator[TrackingFrame]], **given: object) -> tuple[Player, Time]:
    time = Time()
    return Player(source, clock_ns=time.clock_ns, wait=time.wait, **given), time  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("stamps", "rate", "script", "expected"),
    [
        ((100, 120, 160), 1.0, {}, [(0, 100), (20, 120), (60, 160)]),
        ((100, 120, 160), 2.0, {}, [(0, 100), (10, 120), (30, 160)]),
        ((100, 120, 160), 0.5, {}, [(0, 100), (40, 120), (120, 160)]),
        ((100, 120, 160), None, {}, [(0, 100), (0, 120), (0, 160)]),
        ((0, 100, 200), 1.0, {130: "pause", 1000: "resume"}, [(0, 0), (100, 100), (1070, 200)]),
        ((0, 100, 300), 1.0, {50: ("set_rate", 2.0)}, [(0, 0), (75, 100), (175, 300)]),
        (
            (0, 100, 300, 500),
            2.0,
            # Positions 50 and 150; the frame of 100 is played at 125.
            {25: ("set_rate", 0.5), 225: "pause", 1000: "resume", 1100: ("set_rate", None)},
            [(0, 0), (125, 100), (1100, 300), (1100, 500)],
        ),
        ((1000, 1100, 1200, 1300), 1.0, {50: ("seek", 0.15), 120: ("seek", 0.0), 150: "stop"},
         [(0, 1000), (50, 1200), (120, 1000)]),
        ((1000, 1020, 10, 30), 1.0, {}, [(0, 1000), (20, 1020), (20, 10), (40, 30)]),
    ],
    ids=[
        "as recorded", "faster", "slower", "at once", "pause keeps the position", "change of rate",
        "changes of rate and a pause", "seek forward and back", "stamps that jump back",
    ],
)  # fmt: skip
def test_frames_are_played_at_the_rate_and_as_commanded(stamps, rate, script, expected):
    player, time = make(frames(*stamps), rate=rate)
    for ms, command in script.items():
        name, *given = (command,) if isinstance(command, str) else command
        time.at(ms, partial(getattr(player, name), *given))
    assert played(player, time) == expected


def test_steps_pass_at_once_and_stay_paused():
    player, time = make(frames(0, 100, 200, 300))
    player.pause()
    time.at(10, player.step)
    time.at(20, lambda: player.step(2))
    time.at(50, player.resume)
    assert played(player, time) == [(10, 0), (20, 100), (20, 200), (150, 300)]


def test_seek_while_paused_shows_one_frame():
    player, time = make(frames(0, 100, 200))
    player.pause()
    time.at(10, lambda: player.seek(0.1))
    time.at(500, player.stop)
    assert played(player, time) == [(10, 100)]
    assert player.paused


def test_seek_beyond_the_end_ends_the_replay():
    player, time = make(frames(0, 100))
    player.seek(10.0)
    assert played(player, time) == []


def test_stop_also_ends_a_seek():
    def endless() -> Iterator[TrackingFrame]:
        yield TrackingFrame(Stamp(0), ())
        player.seek(1e6)
        player.stop()
        while True:
            yield TrackingFrame(Stamp(0), ())

    player, time = make(endless)
    player.seek(1.0)
    assert played(player, time) == []


def test_loop_restarts_at_the_end():
    player, time = make(frames(0, 10), loop=True)
    assert played(player, time, limit=5) == [(0, 0), (10, 10), (10, 0), (20, 10), (20, 0)]
    empty, time = make(frames(), loop=True)
    assert played(empty, time) == []


def test_a_slow_consumer_gets_every_frame_late():
    player, time = make(frames(0, 10, 20, 30))
    found = []
    for frame in player.play():
        found.append(((time.ns - 5_000 * MS) // MS, frame.stamp.ns // MS))
        time.ns += 15 * MS
    assert found == [(0, 0), (15, 10), (30, 20), (45, 30)]


@given(
    gaps=st.lists(st.integers(1, 500), min_size=1, max_size=20),
    rate=st.sampled_from([0.25, 0.5, 1.0, 2.0, 10.0]),
)
def test_all_frames_are_played_at_any_rate(gaps, rate):
    stamps = [sum(gaps[:n]) for n in range(len(gaps) + 1)]
    player, time = make(frames(*stamps), rate=rate)
    found = played(player, time)
    assert [stamp for _, stamp in found] == stamps
    for clock, stamp in found:
        assert abs(clock - stamp / rate) <= 1


def test_stop_ends_a_real_wait_at_once():
    waiting = threading.Event()

    def wait(event: threading.Event, timeout_s: float | None) -> None:
        waiting.set()
        event.wait(timeout_s)

    player = Player(frames(0, 10_000_000), clock_ns=lambda: 0, wait=wait)
    thread = threading.Thread(target=lambda: list(player.play()))
    thread.start()
    assert waiting.wait(10.0)
    player.stop()
    thread.join(10.0)
    assert not thread.is_alive()


@pytest.mark.parametrize("rate", [0.0, -1.0, float("nan"), 1e9])
def test_invalid_rates_are_refused(rate):
    with pytest.raises(InputError, match="rate"):
        make(frames(0), rate=rate)
    with pytest.raises(InputError, match="rate"):
        make(frames(0))[0].set_rate(rate)


def test_invalid_steps_and_seeks_are_refused():
    player, _ = make(frames(0))
    with pytest.raises(InputError, match="number of steps is 0; expected"):
        player.step(0)
    with pytest.raises(InputError, match="time to seek is -1"):
        player.seek(-1)
