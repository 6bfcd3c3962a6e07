"""A session of a live node in another process, as displays see it: its steps and images."""

import threading
import time
from collections import deque
from collections.abc import Callable, Generator

from marginguard_msgs.msg import SessionContent as ContentMessage
from marginguard_msgs.msg import SessionStep
from marginguard_msgs.srv import GetMesh
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Image

from app.bridge import topics
from app.bridge.calls.service_client import ServiceClient
from app.bridge.displays.remote_operator import COMMAND, GET_MESH, RemoteOperator, received_mesh
from app.bridge.displays.step_message import step_of
from app.bridge.node import RosNode
from app.bridge.ros_errors import BridgeError, CallError
from app.bridge.topics import DISPLAYED, INCOMING_IMAGE, STATIC_TF, Topic
from app.case import read_image_message, standard_image
from app.geometry import ImageSample, InputError
from app.hold import host_id
from app.runtime import (
    ComputeProcess,
    DescribedSession,
    ImageIntake,
    SessionWire,
)
from app.session import LiveImages, StepResult

_MESH_S = 5.0
_MAX_WAITING, _MAX_NEEDED = 3, 100
"""Steps that wait for a display, and for one that needs every step. Of more only the newest is
left: the display is slower than the guard."""
_WAIT_S = 0.2
_DRIFT = 5e-5
"""Largest drift of two machines' clocks."""


class SessionClient:
    """The session of the live node ``node``, received with ``ros``. `StepRun`.

    ``node`` is a full name, or one in the namespace of ``ros``.

    `steps` waits for a node that has not started yet, and follows one that is started again. A
    display that is slower than the node gets the newest step and not those in between, but while it
    `needs_every` one. What it cannot use ends it with a `BridgeError`: messages of another version,
    and steps of two guards at once. ``images`` are those of the session, from the first step on;
    None without. ``waiting(s)`` is called while no step has come for so many seconds; its error
    ends `steps`. ``own``: the first step is that of a node which was started for this display,
    whatever other node has that name.
    """

    def __init__(
        self,
        ros: RosNode,
        node: str,
        *,
        waiting: Callable[[float], None] = lambda _: None,
        own: bool = False,
    ) -> None:
        if not node.startswith("/"):
            node = f"{ros.node.get_namespace().rstrip('/')}/{node}"
        self.node = node
        self.images: LiveImages | None = None
        self.operator: RemoteOperator | None = None
        """Sends the operator's requests; None before the first step."""
        self._ros, self._while_waiting = ros, waiting
        self._own, self._host = own, host_id()
        self._delay = TransportDelay()
        self._wire = SessionWire()
        self._described: dict[str, DescribedSession] = {}
        self._first: DescribedSession | None = None
        self._descriptions: dict[str, ContentMessage] = {}
        self._instance_id, self._ended_ids = "", set[str]()
        self._changed = threading.Condition()
        self.needs_every: Callable[[], bool] = lambda: False
        """Whether the steps are recorded, as by a guided calibration, and not only shown."""
        self._waiting: deque[bytes] = deque(maxlen=_MAX_NEEDED + 1)
        self._cancel = threading.Event()
        self._problem = ""
        self._stopped = False
        self._compute = ComputeProcess()
        self._pictures: TopicImages | None = None
        self._image_problem = ""
        self._depth_mm: float | None = None
        """The imaging depth that ``images`` are placed by."""
        self._meshes = ServiceClient(ros, GetMesh, _name(node, GET_MESH))
        content = Topic(_name(node, topics.CONTENT.name), ContentMessage, STATIC_TF)
        step = Topic(_name(node, topics.STEP.name), SessionStep, DISPLAYED)
        ros.subscribe(content, self._receive_description)
        self._topic = str(ros.subscribe(step, self._receive_step, raw=True).topic_name)

    @property
    def delay_ns(self) -> int:
        """By how much the last step came later than others did since it was made."""
        return self._delay.last_ns

    @property
    def silence(self) -> str:
        """The known reason why no step arrives or can be shown; empty if none is known."""
        if self._problem:
            return self._problem
        if not self._ros.is_open or self._ros.node.count_publishers(self._topic):
            return ""
        return f"no live node {self.node} is there"

    def steps(self) -> Generator[StepResult]:
        """Yield every step as it comes, until `stop`."""
        last_s = time.monotonic()
        while not self._stopped:
            self._while_waiting(time.monotonic() - last_s)
            data = self._next()
            if data is None:
                continue
            message = deserialize_message(data, SessionStep)
            self._follow_instance(message.instance_id)
            session = self._session(message.content_id)
            if session is None:
                continue
            step, others = step_of(message, session.content)
            # Only now: a step that has waited for this thread is as old as that.
            same_host = session.host == self._host
            self._delay.note(message.published_ns, time.time_ns(), same_host=same_host)
            self._use(session, message)
            if self.images is not None:
                self.images.add_poses([*step.frame.poses, *others])
            yield step
            last_s = time.monotonic()

    def stop(self) -> None:
        """End `steps` soon; from any thread."""
        self._cancel.set()
        with self._changed:
            self._stopped = True
            self._changed.notify()

    def pace(self) -> float:
        """The time of live stamps passes as every clock's does."""
        return 1.0

    def close(self) -> None:
        """End images and computations. The node of ``ros`` stays open."""
        self.stop()
        if self._pictures is not None:
            self._pictures.close()
        self._compute.close()

    def _next(self) -> bytes | None:
        with self._changed:
            self._changed.wait_for(lambda: self._waiting or self._stopped, _WAIT_S)
            if len(self._waiting) > (_MAX_NEEDED if self.needs_every() else _MAX_WAITING):
                while len(self._waiting) > 1:
                    self._waiting.popleft()
            return self._waiting.popleft() if self._waiting else None

    def _receive_step(self, data: bytes) -> None:
        with self._changed:
            self._waiting.append(data)
            self._changed.notify()

    def _receive_description(self, message: ContentMessage) -> None:
        with self._changed:
            self._descriptions.pop(message.content_id, None)  # now the newest
            self._descriptions[message.content_id] = message

    def _follow_instance(self, instance_id: str) -> None:
        """Raise `BridgeError` for a step of a guard that another one has replaced."""
        if instance_id == self._instance_id:
            return
        if instance_id in self._ended_ids:
            raise BridgeError(
                f"{self._topic}: steps of two guards at once; expected a single live node"
            )
        if self._instance_id:
            self._ended_ids.add(self._instance_id)
            self._delay = TransportDelay()
        self._instance_id = instance_id

    def _session(self, content_id: str) -> DescribedSession | None:
        """The described session; None while it has not been received."""
        known = self._described.get(content_id)
        if known is not None:
            return known
        message = self._descriptions.get(content_id)
        if message is None:
            return None
        if message.version != ContentMessage.VERSION:
            raise BridgeError(
                f"{self._topic}: a description of version {message.version}; expected "
                f"{ContentMessage.VERSION}: the same MarginGuard on both sides"
            )
        try:
            self._receive_meshes(message.text)
        except CallError as error:  # tried again with the next step
            self._problem = f"a surface of the session is not received: {error}"
            return None
        self._problem = ""
        session = self._wire.described(message.text)
        name = self._ros.node.get_fully_qualified_name()
        if self._own and self.operator is None and name not in session.displays:
            return None
        self._check_same(session)
        self._wire.keep(message.text)
        with self._changed:
            for earlier in list(self._descriptions):  # in the order of their arrival
                if earlier == content_id:
                    break
                del self._descriptions[earlier]
        self._described = {content_id: session}
        return session

    def _receive_meshes(self, text: str) -> None:
        """Receive what the description ``text`` names. Raises `CallError`."""
        for digest in self._wire.missing(text):
            request = GetMesh.Request(digest=digest)
            reply = self._meshes.call(request, _MESH_S, self._cancel, repeat_s=1.0)
            if not reply.success:
                raise CallError(reply.message)
            self._wire.meshes[digest] = received_mesh(
                reply.frame_id, reply.vertices, reply.triangles
            )

    def _check_same(self, session: DescribedSession) -> None:
        """Raise `BridgeError` for another session than the one whose display was made."""
        first, self._first = self._first or session, self._first or session
        for what, before, now in (
            ("name", first.content.name, session.content.name),
            ("tool's tip", first.content.tip_frame, session.content.tip_frame),
            ("tumour's frame", first.content.tumor.frame, session.content.tumor.frame),
            ("robot", first.content.robot_file, session.content.robot_file),
            ("images", self._wire.text(first.images), self._wire.text(session.images)),
        ):
            if before != now:
                raise BridgeError(
                    f"{self.node}: it runs another session now, with another {what}; expected "
                    "that of the display: start the display again"
                )

    def _use(self, session: DescribedSession, message: SessionStep) -> None:
        """Take over what the step says of content, hold and requests; begin with the images."""
        operator = self.operator
        if operator is None:
            operator = RemoteOperator(
                self._ros, _name(self.node, COMMAND), session.content, self._compute.call
            )
        if self.images is None and session.images is not None:
            self.images = session.images.images()
            described = session.images
            self._depth_mm = described.depth_mm
            self._pictures = TopicImages(
                self._ros, described.topic, described.orientation, self.images
            )
        operator.follow(session.content, message)
        self.operator = operator  # from now on others may use it
        depth = session.content.image_depth
        if self.images is not None and message.image_problem != self._image_problem:
            self._image_problem = message.image_problem
            if self._image_problem:
                self.images.refuse(self._image_problem)
        if self.images is not None and depth is not None and depth.depth_mm != self._depth_mm:
            self._depth_mm = depth.depth_mm
            self.images.choose_depth(depth.depth_mm)


class TransportDelay:
    """By how much a message is taken later than the quickest one was, after it was made.

    Both times are system times. On one host they are of one clock, and the whole way counts. On two
    the clocks differ: a delay that all messages share is not known there, and the quickest way is
    followed as slowly as clocks may drift.
    """

    def __init__(self) -> None:
        self.last_ns = 0
        self._least_ns: float | None = None
        self._came_ns = 0

    def note(self, made_ns: int, came_ns: int, *, same_host: bool) -> None:
        """Take the times of the next message."""
        way_ns = came_ns - made_ns
        if self._least_ns is None:
            self._least_ns = way_ns
        drift_ns = _DRIFT * max(came_ns - self._came_ns, 0) if self._came_ns else 0.0
        self._least_ns = min(self._least_ns + drift_ns, way_ns)
        self._came_ns = came_ns
        beyond_ns = round(way_ns - self._least_ns)
        self.last_ns = max(0, beyond_ns, way_ns if same_host else 0)


class TopicImages:
    """Passes the images on ``topic`` to ``images``, in a thread of their own.

    Images of two publishers are refused: they would alternate. They have ``orientation``.
    """

    def __init__(self, ros: RosNode, topic: str, orientation: str, images: LiveImages) -> None:
        self._ros, self._topic, self._orientation = ros, topic, orientation
        self._intake = ImageIntake(images, self._decode)
        self._subscription = ros.subscribe(
            Topic(topic, Image, INCOMING_IMAGE), self._receive, raw=True
        )

    def close(self) -> None:
        """Deliver nothing more."""
        self._intake.close()

    def _receive(self, data: bytes) -> None:
        # Not by the sender of the message: only the newest of several that have come is received.
        self._intake.put((data, self._ros.node.count_publishers(self._topic)))

    def _decode(self, received: tuple[bytes, int]) -> ImageSample:
        data, publishers = received
        if publishers > 1:
            raise InputError(f"{self._topic} has {publishers} publishers of images; expected 1")
        try:
            image = read_image_message(data, 0)
        except InputError as error:
            raise InputError(f"{self._topic}: {error}") from error
        return standard_image(image, self._orientation)


def _name(node: str, relative: str) -> str:
    return f"{node}/{relative.removeprefix('~/')}"
