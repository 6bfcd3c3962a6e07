"""Receive constraints of a running session as plain values, in mm and mm/s."""

import math
import threading
import time
from collections.abc import Iterator
from typing import Self

from marginguard_msgs.msg import FixtureConstraint

from app.bridge.convert.topics import create_endpoint, read_message
from app.bridge.errors import BridgeError
from app.bridge.message_origin import Origin
from app.bridge.messages import MM_PER_M
from app.bridge.node import RosNode
from app.bridge.plain_constraint import plain_constraint
from app.bridge.qos import NEWEST, Topic
from app.bridge.sender_names import node_name, nodes_text
from app.fixture import Constraint, FreeMotion, MarginState, PlainConstraint
from app.geometry import InputError
from app.runtime import LatestValue, ReceivedConstraint
from app.session import Sample, SenderTrail

DEFAULT_TOPIC = "/marginguard/constraint"


class ConstraintReader:
    """``with ConstraintReader() as reader: reader.read()``: constraints as they arrive.

    Only the newest constraint is kept: a slow reader misses older ones. ``for received in reader``
    yields constraints until none arrives for ``timeout_s``, which raises. While two publishers send
    constraints, `read` raises: nothing tells which of them is the session. Call
    `app.bridge.prepare_environment` before.
    """

    def __init__(self, topic: str = DEFAULT_TOPIC, *, timeout_s: float = 5.0) -> None:
        """Raises `BridgeError` for a ``topic`` or ``timeout_s`` that cannot be used."""
        if not 0.0 < timeout_s < math.inf:
            raise BridgeError(f"timeout_s: is {timeout_s!r}; expected seconds > 0")
        self._topic = Topic(topic, FixtureConstraint, NEWEST)
        self._timeout_s = timeout_s
        self._newest: LatestValue[bytes] = LatestValue()
        self._senders, self._lock = SenderTrail(), threading.Lock()
        self._ros = RosNode("constraint_reader")
        try:
            create_endpoint(self._subscribe, topic)
        except BaseException:
            self._ros.close()
            raise

    def _subscribe(self) -> object:
        return self._ros.subscribe_with_origin(self._topic, self._receive)

    def _receive(self, data: bytes, origin: Origin) -> None:
        if origin.sender is not None:
            with self._lock:
                sample = Sample(0, data)
                if not self._senders.observe(origin.sender, sample, time.monotonic_ns()):
                    return
        self._newest.put(data)

    def read(self, timeout_s: float | None = None) -> ReceivedConstraint:
        """The newest constraint that has not been read yet; waits for it.

        Raises `BridgeError` if none arrives in ``timeout_s``, for an invalid message, and while two
        publishers send.
        """
        limit_s = self._timeout_s if timeout_s is None else timeout_s
        raw = self._newest.take(limit_s)
        self._check_single()
        if raw is None:
            raise BridgeError(f"{self._topic.name}: no constraint in {limit_s:g} s{self._cause()}")
        return _received(read_message(raw, self._topic), self._topic.name)

    def close(self) -> None:
        """Leave the ROS graph."""
        self._ros.close()

    def __iter__(self) -> Iterator[ReceivedConstraint]:
        while True:
            yield self.read()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _check_single(self) -> None:
        with self._lock:
            if not self._senders.conflict:
                return
            infos = self._ros.node.get_publishers_info_by_topic(self._topic.name)
            present = {bytes(info.endpoint_gid) for info in infos}
            conflict = self._senders.check(time.monotonic_ns(), present.__contains__)
        if conflict:
            names = nodes_text(node_name(info) for info in infos)
            raise BridgeError(
                f"{self._topic.name}: {len(conflict)} publishers send ({names}); expected one"
            )

    def _cause(self) -> str:
        """The probable cause for which no message has arrived, as the end of an error message."""
        policy = self._ros.incompatible.get(self._topic.name)
        if policy is not None:
            return f"; its publisher has an incompatible {policy}"
        if self._ros.node.count_publishers(self._topic.name) == 0:
            return "; it has no publisher in this ROS domain; expected a running session"
        return "; its publisher is silent; expected a running session"


def _received(message: FixtureConstraint, topic: str) -> ReceivedConstraint:
    try:
        state = MarginState(message.state)
    except ValueError as error:
        raise BridgeError(f"{topic}: state is {message.state}; expected 0 to 3") from error
    if not message.half_spaces and not message.hold:
        raise BridgeError(f"{topic}: no half-spaces and no hold; expected hold without a plane")
    plain = plain_constraint(message)
    return ReceivedConstraint(
        seq=message.seq,
        stamp_ns=plain.stamp_ns,
        valid_until_ns=plain.valid_until_ns,
        state=state,
        reasons=tuple(message.reasons),
        hold=message.hold,
        constraint=_constraint(plain, topic),
        signed_distance_mm=_mm(message.signed_distance),
        lower_bound_mm=_mm(message.lower_bound),
        stop_total_mm=_mm(message.stop_distance),
        warn_total_mm=_mm(message.warn_distance),
        sigma_tre_mm=_mm(message.sigma_tre),
        model_id=message.model_id,
        registration_id=message.registration_id,
        setup_id=message.setup_id,
        max_tool_speed_mm_s=plain.max_tool_speed_mm_s,
        max_tool_turn_rad_s=plain.max_tool_turn_rad_s,
        instance_id=message.instance_id,
        rearm_nonce=message.rearm_nonce,
        hold_causes=tuple(message.hold_causes),
        simulated=message.simulated,
        planes_current=message.planes_current,
        single_source=message.single_source,
    )


def _constraint(plain: PlainConstraint, topic: str) -> Constraint | None:
    if len(plain.normals) == 0:
        return None
    try:
        return Constraint(
            frame=plain.frame,
            normals=plain.normals,
            offsets_mm=plain.offsets_mm,
            points_on_tool_mm=plain.points_on_tool_mm,
            tumor_velocities_mm_s=plain.tumor_velocities_mm_s,
            hold=plain.hold,
            free=FreeMotion(plain.free_distance_mm, plain.free_turn_rad),
        )
    except InputError as error:
        raise BridgeError(f"{topic}: invalid half-spaces: {error}") from error


def _mm(value_m: float) -> float | None:
    return value_m * MM_PER_M if math.isfinite(value_m) else None
