"""Step a world at the pace of a clock, and publish its time where no guard runs."""

import threading
import time
from collections.abc import Callable
from typing import Final, Protocol

from app.bridge import topics
from app.bridge.messages import clock_message
from app.bridge.node import RosNode
from app.bridge.sender_names import publishers_text
from app.geometry import NS_PER_MS, NS_PER_S, Stamp
from app.simulation import World, WorldState

MAX_LAG_NS = 30 * NS_PER_MS
"""A physics that is further behind is no longer real time: arms stop, and the lag is dropped."""

_REPORT_NS = NS_PER_S

CONSTRAINT_TYPE: Final = "marginguard_msgs/msg/FixtureConstraint"

DISCOVERY_S: Final = 1.0
"""Nothing is published before, so that the nodes that run already are known."""

_CHECK_S = 0.2


class Shell(Protocol):
    """Connection of the world to its users; called in the thread of `RealTime.run`."""

    def step(self, world: World, now_ns: int) -> WorldState:
        """Take one step with what has arrived until ``now_ns`` of the host's clock."""

    def publish(self, state: WorldState, stamp_ns: int) -> None:
        """Publish ``state``, which has the stamp ``stamp_ns`` of the host's clock."""

    def idle(self) -> None:
        """Called instead of a step while the world is paused."""

    def report(self, real_time_factor: float, lags: int) -> None:
        """Publish the simulated time per time of the clock in the last second, and the lags."""


class RealTime:
    """Runs ``world`` along ``clock_ns``, a steady clock; ``host_ns`` gives the time since 1970.

    Simulated time 0 is the host time of the start. After a lag of more than `MAX_LAG_NS`, or a
    pause, the following states are that much later on the host's clock.
    """

    def __init__(
        self,
        world: World,
        *,
        clock_ns: Callable[[], int],
        host_ns: Callable[[], int],
        wait: Callable[[float], object],
    ) -> None:
        self._world = world
        self._clock_ns, self._wait = clock_ns, wait
        self._offset_ns = host_ns() - clock_ns()
        self._start_ns = clock_ns() - world.time_ns
        self._lock = threading.Lock()
        self._paused = False
        self._single_steps = 0
        self._resets = 0
        self.lags = 0
        """Number of times that the physics fell behind."""

    def pause(self) -> None:
        """Stand still from the next step on."""
        with self._lock:
            self._paused = True

    def resume(self) -> None:
        """Go on."""
        with self._lock:
            self._paused, self._single_steps = False, 0

    def step_once(self) -> None:
        """Pause, and take one step."""
        with self._lock:
            self._paused = True
            self._single_steps += 1

    def reset(self) -> None:
        """Begin again at simulated time 0, before the next step."""
        with self._lock:
            self._resets += 1

    def run(self, shell: Shell, stop: threading.Event) -> None:
        """Step until ``stop``. Raises `UnstableError` where the physics diverges."""
        world, step_ns = self._world, self._world.description.timestep_ns
        report_ns, reported_ns = self._clock_ns(), world.time_ns
        while not stop.is_set():
            self._reset_if_asked()
            now_ns = self._clock_ns()
            if now_ns - report_ns >= _REPORT_NS:
                simulated_ns = max(0, world.time_ns - reported_ns)
                shell.report(simulated_ns / (now_ns - report_ns), self.lags)
                report_ns, reported_ns = now_ns, world.time_ns
            if not self._may_step():
                self._start_ns = now_ns - world.time_ns
                shell.idle()
                self._wait(step_ns / NS_PER_S)
                continue
            behind_ns = now_ns - self._start_ns - world.time_ns
            if behind_ns < step_ns:
                self._wait((step_ns - behind_ns) / NS_PER_S)
                continue
            if behind_ns > MAX_LAG_NS:
                self._drop(behind_ns)
            state = shell.step(world, now_ns + self._offset_ns)
            shell.publish(state, self._start_ns + state.time_ns + self._offset_ns)

    def _drop(self, behind_ns: int) -> None:
        self._start_ns += behind_ns
        self.lags += 1
        for name, arm in self._world.state().arms.items():
            if not arm.fault:
                reason = f"the physics was {behind_ns // NS_PER_MS} ms behind real time"
                self._world.fail(name, reason)

    def _may_step(self) -> bool:
        with self._lock:
            if not self._paused:
                return True
            may_step = self._single_steps > 0
            self._single_steps -= int(may_step)
            return may_step

    def _reset_if_asked(self) -> None:
        with self._lock:
            asked, self._resets = self._resets, 0
        if asked:
            self._start_ns += self._world.time_ns  # host time goes on
            self._world.reset()


class ClockTopic:
    """Publishes the time of the states on ``/clock`` until a guard or another clock appears.

    A guard judges ages on the clock of its host, and so does a controller; a clock that stands with
    the physics would make old data look fresh to nodes that use it. From then on nothing is
    published any more, and `problem` says why. Thread-safe.
    """

    def __init__(self, ros: RosNode) -> None:
        self._ros = ros
        self._publisher = ros.publisher(topics.CLOCK)
        self._begins_s = time.monotonic() + DISCOVERY_S
        self._is_checked = False
        self.problem = ""
        """The reason why ``/clock`` is not published; empty if it is, or will be."""
        ros.every(_CHECK_S, self._check)

    def publish(self, stamp_ns: int) -> None:
        """Publish ``stamp_ns``, the stamp of the state on the clock of the host."""
        if self._is_checked and not self.problem:
            self._publisher.publish(clock_message(Stamp(stamp_ns)))

    def _check(self) -> None:
        """Look for guards and other clocks. Runs in the node's thread."""
        if self.problem or not self._ros.is_open:
            return
        self.problem = self._found()
        if self.problem:
            self._ros.node.get_logger().error(f"/clock is not published any more: {self.problem}")
        self._is_checked = time.monotonic() >= self._begins_s

    def _found(self) -> str:
        node = self._ros.node
        if node.count_publishers(topics.CLOCK.name) > 1:
            infos = node.get_publishers_info_by_topic(topics.CLOCK.name)
            return f"{publishers_text(infos)} publish it; expected one node"
        for name, types in node.get_topic_names_and_types():
            if CONSTRAINT_TYPE in types:
                infos = node.get_publishers_info_by_topic(name)
                if infos:
                    return f"{publishers_text(infos)} guards with {name}; expected no guard"
        return ""
