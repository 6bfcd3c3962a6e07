"""A replay's messages in a bag instead of on the ROS graph, for Foxglove and ``ros2 bag play``.

They are those that `SessionPublisher` publishes, without ``/clock``, which a player publishes
itself. The time of a message is that of its step, so that the bag plays in the time of the case.
"""

import random
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from rclpy.logging import get_logger
from rclpy.serialization import serialize_message

from app.bridge import topics
from app.bridge.bag_topics import bag_topic
from app.bridge.message_definitions import check_installed
from app.bridge.publishing.session_publisher import NODE_NAME, SessionPublisher
from app.bridge.qos import Topic
from app.case import BagWriter
from app.runtime import SessionContent, StepTiming
from app.session import StepResult


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

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        try:
            self._publisher.close()
        finally:
            self._bag.close()


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

    def publisher(self, topic: Topic) -> "_BagPublisher | _NoPublisher":
        """A publisher that writes to the bag; that of the clock writes nothing."""
        name = topic.name.replace("~", f"/{NODE_NAME}", 1)
        if topic is topics.CLOCK:
            return _NoPublisher()
        if name not in self._names:
            self._names.add(name)
            self._bag.add_topic(bag_topic(name, topic))
        return _BagPublisher(lambda data: self._write(name, data))

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


class _BagPublisher:
    def __init__(self, write: Callable[[bytes], None]) -> None:
        self._write = write

    def publish(self, message: object) -> None:
        """Write ``message``, which may be serialised already."""
        data = message if isinstance(message, bytes) else bytes(serialize_message(message))
        self._write(data)


class _NoPublisher:
    def publish(self, message: object) -> None:
        """Write nothing."""
