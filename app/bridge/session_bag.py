"""A replay's messages in a bag instead of on the ROS graph, for Foxglove and ``ros2 bag play``.

They are those that `SessionPublisher` publishes, without ``/clock``, which a player publishes
itself. The time of a message is that of its step, so that the bag plays in the time of the case.
"""

import random
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from rclpy.logging import get_logger
from rclpy.serialization import serialize_message

from app.bridge import topics
from app.bridge.bag_topics import bag_topic
from app.bridge.message_definitions import check_installed
from app.bridge.messages import playback_text
from app.bridge.publishing.session_publisher import NODE_NAME, SessionPublisher
from app.bridge.qos import Topic
from app.case import BagWriter
from app.files.atomic_io import new_folder
from app.runtime import ReplayRun, SessionContent, StepTiming, SwitchContent
from app.session import StepResult


class _CancelledError(Exception):
    """The replay was stopped: its bag is not kept."""


@contextmanager
def session_bag(run: ReplayRun, folder: Path, *, keep: Callable[[], bool]) -> Iterator[None]:
    """Within the context the steps of ``run`` are written to the new rosbag2 folder ``folder``.

    It appears complete at the end, unless the body raises or ``keep()`` is false. The same case
    gives the same messages. Raises `InputError` for a folder that exists or cannot be written.
    """
    check_installed()
    try:
        with new_folder(folder) as partial:
            partial.rmdir()  # the bag creates its folder
            bag = BagWriter(partial)
            try:
                output = SessionBag(run, bag)
                run.outputs.append(output)
                try:
                    yield
                finally:
                    run.outputs.remove(output)
                    output.close()
            finally:
                bag.close()
            if not keep():
                raise _CancelledError
    except _CancelledError:
        return


class SessionBag:
    """`Output` that writes the messages of a session to ``bag``."""

    def __init__(self, run: ReplayRun, bag: BagWriter) -> None:
        self._endpoints = _BagEndpoints(bag)
        content = run.commands.content
        self._publisher = SessionPublisher(
            content,
            playback=playback_text(run.prepared.case.manifest),
            endpoints=self._endpoints,
            random_bits=random.Random(content.model_id).getrandbits,
            clock_ns=lambda: self._endpoints.now_ns or 0,
        )

    def publish(self, step: StepResult, timing: StepTiming) -> bool:
        """Write the messages of ``step``. A bag permits no motion: no step is too late."""
        self._endpoints.begin(step.frame.stamp.ns)
        self._publisher.publish(step, timing)
        return True

    def prepare(self, content: SessionContent) -> SwitchContent:
        """As that of `SessionPublisher`."""
        return self._publisher.prepare(content)

    def revoke(self) -> None:
        """Nothing to withdraw."""

    def latch(self, causes: Sequence[str]) -> None:
        """Write the hold."""
        self._publisher.latch(causes)

    def end(self) -> None:
        """Write a last constraint on hold."""
        self._publisher.end()

    def close(self) -> None:
        """Write nothing more."""
        self._publisher.close()


class _BagEndpoints:
    """What `SessionPublisher` needs of a node: publishers, which write to a bag.

    Messages before the first step, such as static frames, have the time of that step.
    """

    definition_problems: Sequence[str] = ()

    def __init__(self, bag: BagWriter) -> None:
        self._bag = bag
        self._waiting: list[tuple[str, bytes]] = []
        self._names: set[str] = set()
        self.now_ns: int | None = None

    def publisher(self, topic: Topic) -> "_BagPublisher":
        """A publisher that writes to the bag; that of the clock writes nothing."""
        name = topic.name.replace("~", f"/{NODE_NAME}", 1)
        if topic is topics.CLOCK:
            return _BagPublisher(lambda data: None)
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
