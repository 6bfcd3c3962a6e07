"""A replay's messages in a bag instead of on the ROS graph, for Foxglove and ``ros2 bag play``.

They are those that `SessionPublisher` publishes, without ``/clock``, which a player publishes
itself. The time of a message is that of its step, so that the bag plays in the time of the case.
"""

import json
import os
import random
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Self

from rclpy.logging import get_logger
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
)
from rclpy.serialization import serialize_message

from app.bridge import topics
from app.bridge.message_definitions import check_installed
from app.bridge.publishing.session_publisher import NODE_NAME, SessionPublisher
from app.bridge.topics import Topic
from app.case import BagTopic, BagWriter, message_definition
from app.geometry import NS_PER_S
from app.runtime import SessionContent, StepTiming
from app.session import StepResult

_INFINITE_NS = 2**63 - 1


def bag_topic(name: str, topic: Topic) -> BagTopic:
    """``topic`` with its full ``name``; raises `InputError` if its type is not installed."""
    package, kind = topic.type.__module__.partition(".")[0], topic.type.__name__
    return BagTopic(
        name,
        f"{package}/msg/{kind}",
        message_definition(f"{package}/msg/{kind}", ros_prefixes()),
        (offered(topic.qos),),
        _type_hash(package, kind),
    )


def ros_prefixes() -> tuple[Path, ...]:
    """Prefixes of ROS installations and of this Python, where ROS packages are installed."""
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    return (*(Path(prefix) for prefix in prefixes if prefix), Path(sys.prefix))


def offered(profile: QoSProfile) -> dict[str, Any]:
    """QoS profile of a publisher in the format of rosbag2."""
    return {
        "history": HistoryPolicy(profile.history).name.lower(),
        "depth": profile.depth,
        "reliability": ReliabilityPolicy(profile.reliability).name.lower(),
        "durability": DurabilityPolicy(profile.durability).name.lower(),
        "deadline": _duration(profile.deadline.nanoseconds),
        "lifespan": _duration(profile.lifespan.nanoseconds),
        "liveliness": LivelinessPolicy(profile.liveliness).name.lower(),
        "liveliness_lease_duration": _duration(profile.liveliness_lease_duration.nanoseconds),
        "avoid_ros_namespace_conventions": bool(profile.avoid_ros_namespace_conventions),
    }


def _type_hash(package: str, kind: str) -> str:
    """Hash of an installed message type, ``RIHS01_...``; empty if it is not known."""
    for prefix in ros_prefixes():
        try:
            text = (prefix / "share" / package / "msg" / f"{kind}.json").read_text("utf-8")
            for each in json.loads(text)["type_hashes"]:
                if each["type_name"] == f"{package}/msg/{kind}":
                    return str(each["hash_string"])
        except (OSError, ValueError, KeyError, TypeError):
            continue
    return ""


def _duration(ns: int) -> dict[str, int]:
    seconds, nanoseconds = divmod(min(ns, _INFINITE_NS), NS_PER_S)
    return {"sec": seconds, "nsec": nanoseconds}


class SessionBag:
    """Writes the messages of a session to the new rosbag2 folder ``folder``.

    Use as ``with SessionBag(content, playback, folder) as bag``; at the end the bag is complete.
    ``playback`` is the text of `app.bridge.messages.playback_text`. The same steps give the same
    messages. Raises `InputError` for a folder that exists or cannot be written.
    """

    def __init__(self, content: SessionContent, playback: str, folder: Path) -> None:
        check_installed()
        self._bag = BagWriter(folder)
        self._content = content
        self._endpoints = _BagEndpoints(self._bag)
        try:
            self._publisher = SessionPublisher(
                content,
                playback=playback,
                endpoints=self._endpoints,
                random_bits=random.Random(content.model_id).getrandbits,
                clock_ns=lambda: self._endpoints.now_ns or 0,
            )
        except BaseException:
            self._bag.close()
            raise

    def publish(self, step: StepResult) -> None:
        """Write the messages of ``step``. A bag permits no motion: no step is too late."""
        self._endpoints.begin(step.frame.stamp.ns)
        self._publisher.publish(step, StepTiming())

    def use(self, **changes: Any) -> None:
        """Use the content with these fields changed from the next step on.

        Fields that have not changed stay the same objects: see `SessionPublisher.prepare`.
        """
        self._content = replace(self._content, **changes)
        self._publisher.prepare(self._content)(self._content)

    def latch(self, causes: Sequence[str]) -> None:
        """Write the hold."""
        self._publisher.latch(causes)

    def end(self) -> None:
        """Write a last constraint on hold."""
        self._publisher.end()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self._publisher.close()
        finally:
            self._bag.close()


def _bytes_of(message: object) -> bytes:
    """``message`` as bytes, which it may be already."""
    return message if isinstance(message, bytes) else bytes(serialize_message(message))


class _BagEndpoints:
    """The endpoints of a node that `SessionPublisher` uses, with publishers that write to a bag.

    Messages before the first step, such as static frames, have the time of that step.
    """

    definition_problems: Sequence[str] = ()

    def __init__(self, bag: BagWriter) -> None:
        self._bag = bag
        self._waiting: list[tuple[str, bytes]] = []
        self._names: set[str] = set()
        self.now_ns: int | None = None

    def publisher(self, topic: Topic) -> SimpleNamespace:
        """A publisher that writes to the bag; that of the clock writes nothing."""
        name = topic.name.replace("~", f"/{NODE_NAME}", 1)
        if topic is topics.CLOCK:
            return SimpleNamespace(publish=lambda _: None)
        if name not in self._names:
            self._names.add(name)
            self._bag.add_topic(bag_topic(name, topic))
        return SimpleNamespace(publish=lambda message: self._write(name, _bytes_of(message)))

    def destroy_publisher(self, publisher: object) -> None:
        """Nothing to release."""

    def warn(self, text: str) -> None:
        """Log ``text``."""
        get_logger(NODE_NAME).warning(text)

    def begin(self, now_ns: int) -> None:
        """The following messages have the time ``now_ns``."""
        self.now_ns = now_ns
        waiting, self._waiting = self._waiting, []
        for name, data in waiting:
            self._write(name, data)

    def _write(self, name: str, data: bytes) -> None:
        if self.now_ns is None:
            self._waiting.append((name, data))
        else:
            self._bag.write(name, data, received_ns=self.now_ns, published_ns=self.now_ns)
