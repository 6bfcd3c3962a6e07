"""Receive the constraints of a running guard with their times, and re-arm it."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import pytest
from marginguard_msgs.msg import FixtureConstraint

from app.bridge.control.operator_services import RearmClient
from app.bridge.node import RosNode
from app.bridge.topics import STREAM, Topic
from tests.waiting import DEADLINE_S

REARM_S = 30.0


@dataclass(frozen=True, slots=True)
class Received:
    """A constraint and the system time of its arrival."""

    at_ns: int
    message: FixtureConstraint

    @property
    def is_permissive(self) -> bool:
        """True if it is of a guard and allows an approach."""
        return bool(self.message.instance_id) and not self.message.hold

    @property
    def has_second_sender(self) -> bool:
        return "second_sender" in self.message.reasons


class GuardMonitor:
    """All constraints of the guard ``marginguard`` since the beginning."""

    def __init__(self, ros: RosNode) -> None:
        self._changed = threading.Condition()
        self._client = RearmClient(ros, "marginguard")
        self.received: list[Received] = []
        ros.subscribe(Topic("/marginguard/constraint", FixtureConstraint, STREAM), self._take)

    def until(self, accept: Callable[[Received], bool], since_ns: int | None = None) -> Received:
        """Wait for the first constraint from ``since_ns`` on (default now) that is accepted."""
        begin_ns = time.time_ns() if since_ns is None else since_ns

        def found() -> Received | None:
            for each in self.received:
                if each.at_ns >= begin_ns and accept(each):
                    return each
            return None

        with self._changed:
            if not self._changed.wait_for(lambda: found() is not None, DEADLINE_S):
                last = self.received[-1].message if self.received else None
                pytest.fail(f"no such constraint in {DEADLINE_S} s; the last is {last}")
            result = found()
        assert result is not None
        return result

    def since(self, begin_ns: int) -> list[Received]:
        """Constraints that have arrived from ``begin_ns`` on."""
        with self._changed:
            return [each for each in self.received if each.at_ns >= begin_ns]

    def make_permissive(self) -> None:
        """Wait until the guard may be re-armed, re-arm it, wait for a permissive constraint."""
        self.until(lambda each: each.message.state != FixtureConstraint.UNKNOWN)
        while True:
            seen = self._client.constraint(DEADLINE_S)
            if not seen.hold:
                return
            self._client.rearm(seen, REARM_S)

    def _take(self, message: FixtureConstraint) -> None:
        with self._changed:
            self.received.append(Received(time.time_ns(), message))
            self._changed.notify_all()


@contextmanager
def monitored(domain_id: int) -> Iterator[GuardMonitor]:
    """Monitor in a node of its own."""
    with RosNode("monitor", domain_id=domain_id) as ros:
        yield GuardMonitor(ros)
