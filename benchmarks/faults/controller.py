"""A controller on the graph: pushes towards the tumour, and records what it is permitted."""

import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import partial
from operator import attrgetter
from typing import Any

import numpy as np
import rclpy
from geometry_msgs.msg import PointStamped, TwistStamped
from marginguard_msgs.msg import FixtureConstraint
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message

from app.bridge.constraint_message import plain_constraint
from app.fixture import FixtureRule, RuleReason
from app.geometry import NS_PER_S
from benchmarks.faults.foreign_peer import Requests
from benchmarks.faults.records import APPROACH_MM_S, Constraint, Content, Twist
from benchmarks.faults.scene import PERIOD_NS, Scene
from benchmarks.harness.peer import seq_of, set_time

SAFE, TIP = "/safe_twist", "/tip"
"""Topics of `examples/controller/twist_filter.py`."""

PUSH_MM_S = 50.0
PUSH_PERIOD_S = 0.02
JUDGED_AGE_NS = 150_000_000  # planes are older than the answer: the most favourable truth counts


class Controller:
    """Node ``controller``. ``frame`` is that of the desired twists: ``tumor`` or ``robot_base``.

    It is the operator, too: it re-arms and sets parameters. ``scene`` is the truth, by which the
    answers are judged.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.frame = "tumor"
        self._constraints: list[Constraint] = []
        self._twists: list[Twist] = []
        self._contents: OrderedDict[bytes, Content] = OrderedDict()
        self._changed = threading.Condition()
        self._closing = threading.Event()
        rclpy.init()
        self.node = rclpy.create_node("controller")
        subscribe, guard = self.node.create_subscription, "/marginguard"
        take, qos = self._take_constraint, QoSProfile(depth=2000)
        subscribe(FixtureConstraint, f"{guard}/constraint", take, qos, raw=True)
        subscribe(TwistStamped, f"{guard}/allowed_twist", self._take_twist, 100)
        self._desired = self.node.create_publisher(TwistStamped, f"{guard}/desired_twist", 1)
        self._safe: list[Twist] = []
        subscribe(TwistStamped, SAFE, partial(self._take_twist, kept=self._safe), 100)
        self._tip = self.node.create_publisher(PointStamped, TIP, 1)
        self.requests = Requests(self.node, timeout_s=5.0)
        executor = SingleThreadedExecutor()
        executor.add_node(self.node)
        self._threads = [
            threading.Thread(target=self._spin, args=(executor,), daemon=True),
            threading.Thread(target=self._push, daemon=True),
        ]
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        self._closing.set()
        self._threads[1].join()
        rclpy.shutdown()
        self._threads[0].join()

    def latest(self) -> Constraint | None:
        """The last received constraint since `forget`."""
        with self._changed:
            return self._constraints[-1] if self._constraints else None

    def forget(self) -> None:
        with self._changed:
            self._constraints.clear()
            self._twists.clear()
            self._safe.clear()

    def records(self) -> tuple[list[Constraint], list[Twist]]:
        """All records since `forget`, in the order of sending."""
        with self._changed:
            sent = attrgetter("sent_ns")
            return sorted(self._constraints, key=sent), sorted(self._twists, key=sent)

    def safe_twists(self) -> list[Twist]:
        """Twists that the example controller has sent since `forget`, in the order of sending."""
        with self._changed:
            return sorted(self._safe, key=attrgetter("sent_ns"))

    def wait(self, accept: Callable[[], bool], timeout_s: float) -> bool:
        """Wait until ``accept`` is true; it is called after each new content and each answer."""
        with self._changed:
            return self._changed.wait_for(accept, timeout_s)

    def wait_until(self, ns: int) -> None:
        while (ahead_ns := ns - time.time_ns()) > 0:
            time.sleep(ahead_ns / NS_PER_S)

    def _take_constraint(self, raw: bytes, info: dict[str, int]) -> None:
        arrived_ns = time.time_ns()
        seq = seq_of(raw)
        at = raw.find(seq.to_bytes(8, "little"), 12)
        key = raw[:at] + raw[at + 8 :]
        content = self._contents.get(key)
        new = content is None
        if content is None:
            content = self._contents[key] = _content(raw)
            if len(self._contents) > 8:
                self._contents.popitem(last=False)
        with self._changed:
            self._constraints.append(Constraint(info["source_timestamp"], arrived_ns, seq, content))
            if new:
                self._changed.notify_all()

    def _take_twist(
        self, answer: TwistStamped, info: dict[str, int], kept: list[Twist] | None = None
    ) -> None:
        arrived_ns, sent_ns = time.time_ns(), info["source_timestamp"]
        linear = answer.twist.linear
        velocity = 1000.0 * np.array([linear.x, linear.y, linear.z])
        approach = min(
            float(velocity @ self._direction(sent_ns - age_ns, answer.header.frame_id))
            for age_ns in range(0, JUDGED_AGE_NS, PERIOD_NS)
        )
        with self._changed:
            twists = self._twists if kept is None else kept
            twists.append(Twist(sent_ns, arrived_ns, approach))
            self._changed.notify_all()

    def _direction(self, ns: int, frame: str) -> Any:
        """Unit vector towards the tumour in ``frame``, by the truth."""
        truth = self.scene.at(ns)
        return truth.approach if frame == "tumor" else truth.base_from_tumor @ truth.approach

    def _spin(self, executor: SingleThreadedExecutor) -> None:
        with suppress(ExternalShutdownException):
            executor.spin()

    def _push(self) -> None:
        while not self._closing.wait(PUSH_PERIOD_S):
            now_ns, frame = time.time_ns(), self.frame
            push = PUSH_MM_S / 1000.0 * self._direction(now_ns, frame)
            message = TwistStamped()
            message.header.frame_id = frame
            set_time(message.header.stamp, now_ns)
            linear = message.twist.linear
            linear.x, linear.y, linear.z = map(float, push)
            self._desired.publish(message)
            latest = self.latest()
            raw = None if latest is None else latest.content.raw
            planes = raw and deserialize_message(raw, FixtureConstraint).half_spaces
            if planes:  # the tool's point at the governing plane stands for an example's tip
                tip = PointStamped(point=planes[0].point_on_tool)
                tip.header.frame_id = "tumor"
                self._tip.publish(tip)


def _content(raw: bytes) -> Content:
    message = deserialize_message(raw, FixtureConstraint)
    return Content(
        instance_id=message.instance_id,
        stamp_ns=_ns(message.header.stamp),
        valid_until_ns=_ns(message.valid_until),
        state=message.state,
        reasons=tuple(message.reasons),
        hold=message.hold,
        nonce=message.rearm_nonce,
        stop_mm=1000.0 * message.stop_distance,
        single_source=getattr(message, "single_source", None),
        model_id=message.model_id,
        raw=raw,
    )


def _ns(stamp: Any) -> int:
    return int(stamp.sec * NS_PER_S + stamp.nanosec)


def rule_approaches(constraints: Iterable[Constraint], scene: Scene, *, after_ns: int) -> int:
    """Number of messages sent after ``after_ns`` on which the documented rule allows an approach.

    The rule gets the messages in their order of arrival, and one control step follows each. The
    point of the tool at the governing plane stands for the tip.
    """
    rule = FixtureRule(frame="tumor")
    count = 0
    for each in sorted(constraints, key=lambda one: one.arrived_ns):
        message = deserialize_message(each.content.raw, FixtureConstraint)
        message.seq = each.seq
        rule.receive(plain_constraint(message), each.arrived_ns)
        approach, tip = scene.at(each.arrived_ns).approach, np.zeros(3)
        if message.half_spaces:
            point = message.half_spaces[0].point_on_tool
            tip = 1000.0 * np.array([point.x, point.y, point.z])
        desired = np.concatenate([PUSH_MM_S * approach, np.zeros(3)])
        decision = rule.allow(desired, tip, each.arrived_ns)
        rule.stand(each.arrived_ns)  # the tool is not moved
        allowed = float(decision.twist[:3] @ approach) > APPROACH_MM_S
        count += allowed and each.sent_ns > after_ns and decision.reason is RuleReason.ALLOWED
    return count
