"""The receivers that are compared, each a row of the table."""

from collections.abc import Callable
from dataclasses import dataclass

from benchmarks.latency.bodies import body_frames
from benchmarks.latency.qt_loops import KEPT, RELEASED
from benchmarks.latency.qt_receiver import Waking
from benchmarks.latency.receivers import PlainListener, PolledIgtl, Receiver, Timer

RATE_HZ = 199.5
"""Not a multiple of a timer's rate: their phases drift through a period every two seconds, so that
the phase, which is random, does not decide the result."""

Open = Callable[[int, float, int | None], Receiver]
"""Makes the receiver for a number of bodies, seconds, and a TCP port."""


@dataclass(frozen=True, slots=True)
class Kind:
    """A row of the table. ``sends``: ``tf`` or ``igtl``, or ``session`` for a tracker."""

    name: str
    what: str
    sends: str
    open: Open
    rate_hz: float = RATE_HZ


def _module(waking: Waking) -> Open:
    def opened(bodies: int, seconds: float, port: int | None) -> Receiver:
        from benchmarks.latency.module import BodiesInModule

        return BodiesInModule(body_frames(bodies), waking)

    return opened


def _panel(waking: Waking) -> Open:
    def opened(bodies: int, seconds: float, port: int | None) -> Receiver:
        from benchmarks.latency.session import PanelReceiver

        return PanelReceiver(waking)

    return opened


def _page(bodies: int, seconds: float, port: int | None) -> Receiver:
    from benchmarks.latency.session import PageReceiver

    return PageReceiver()


def _igtl(bodies: int, seconds: float, port: int | None) -> Receiver:
    return PolledIgtl(body_frames(bodies), Timer(200.0, seconds), port or 0)


LISTENER, OURS, POLLED = "rclpy listener", "module ROS2", "timer 5 ms"
SESSION_HZ = 200.0
KINDS = (
    Kind(LISTENER, "transport alone: rclpy, no scene", "tf", lambda *_: PlainListener()),
    Kind(OURS, "woken by messages", "tf", _module(Waking(RELEASED))),
    Kind(f"{OURS}, {KEPT}", "the same, loop as PythonQt's", "tf", _module(Waking(KEPT))),
    Kind(POLLED, "the same module, polled", "tf", _module(Waking(RELEASED, 5))),
    Kind("timer 20 ms", "polled, as before", "tf", _module(Waking(RELEASED, 20))),
    Kind(f"timer 20 ms, {KEPT}", "as before, as PythonQt's", "tf", _module(Waking(KEPT, 20))),
    Kind("OpenIGTLink", "pyigtl, polled at 200 Hz", "igtl", _igtl),
    Kind("panel", "a session, woken", "session", _panel(Waking(RELEASED)), SESSION_HZ),
    Kind(f"panel, {KEPT}", "a session, woken", "session", _panel(Waking(KEPT)), SESSION_HZ),
    Kind("panel, timer 20 ms", "polled, as before", "session", _panel(Waking(RELEASED, 20)),
         SESSION_HZ),
    Kind("page", "a session in the live page", "session", _page, SESSION_HZ),
)  # fmt: skip
