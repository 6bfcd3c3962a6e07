"""Endpoints of a live node for displays: its steps, its description, its surfaces, its commands."""

import threading
import time
from collections import deque
from collections.abc import Callable, Sequence

from marginguard_msgs.msg import SessionContent as ContentMessage
from marginguard_msgs.srv import Command, GetMesh
from rclpy.node import NodeNameNonExistentError

from app.bridge import topics
from app.bridge.calls.service_server import ServiceServer
from app.bridge.control.operator_requests import OperatorRequests
from app.bridge.displays.remote_operator import (
    COMMAND,
    GET_MESH,
    origin_text,
    received_mesh,
    write_mesh,
)
from app.bridge.displays.step_message import StepOrigin, step_message
from app.bridge.node import RosNode
from app.bridge.ros_errors import BridgeError
from app.geometry import SurfaceMesh, TrackedTransform
from app.hold import Holds, SeenHold, host_id
from app.runtime import (
    ImageDescription,
    OperatorCommands,
    PassiveOutput,
    RecordingStatus,
    RequestKind,
    RequestLog,
    SessionContent,
    StepTiming,
    SwitchContent,
)
from app.runtime.operator_command import OperatorCommand, Rearm, SetMargins
from app.runtime.requests import RateLimit
from app.runtime.session_changes import MAX_LIVE_TRIANGLES
from app.runtime.session_wire import (
    DescribedSession,
    SessionWire,
    command_kind,
    mesh_digest,
    text_digest,
)
from app.session import StepResult

_KNOWN_WITHIN_S = 2.0
"""A client that asks at once after its start may not be known yet to the graph."""
_LOOK_S = 0.02
_MAX_OTHERS = 1000
_MESHES_PER_S, _MESHES_AT_ONCE = 2.0, 20.0
_MAX_WAITING = 1000
"""Requests that wait for the node's thread, as for ~/rearm."""
_MAX_ARGUMENTS, _MAX_REARM = 64_000, 200
"""Characters of a command's arguments: reading them keeps the interpreter's lock."""


class DisplayOutput(PassiveOutput):
    """`Output` that publishes each step on ``~/step`` while a display subscribes to it.

    ``content``, and each later one, is described on ``~/content``; ``~/get_mesh`` serves its
    surfaces. ``images`` are those of the session, ``displays`` the nodes that it was started for.
    ``instance_id`` is that of its constraints, ``holds`` identifies the hold that they show.
    """

    def __init__(
        self,
        ros: RosNode,
        content: SessionContent,
        images: ImageDescription | None,
        displays: Sequence[str],
        *,
        instance_id: str,
        holds: Holds,
        requests: RequestLog,
        recording: Callable[[], RecordingStatus | None],
        image_problem: Callable[[], str],
    ) -> None:
        self._ros, self._instance_id = ros, instance_id
        self._images, self._displays, self._holds = images, tuple(displays), holds
        self._requests, self._recording = requests, recording
        self._image_problem = image_problem
        self._host = host_id()
        self._wire = SessionWire()
        self._others: deque[TrackedTransform] = deque(maxlen=_MAX_OTHERS)
        self._texts: dict[str, tuple[object, str]] = {}
        self._steps = ros.publisher(topics.STEP)
        self._descriptions = ros.publisher(topics.CONTENT)
        self._content_id = ""
        self._use(content)
        self._meshes_limit = RateLimit(_MESHES_PER_S, _MESHES_AT_ONCE)
        ServiceServer(
            ros, GetMesh, GET_MESH, self._get_mesh, in_thread=True, check=self._check_mesh
        )

    def publish(self, step: StepResult, timing: StepTiming) -> bool:
        """Publish ``step``. True: it permits nothing, so it is never too late."""
        others = [self._others.popleft() for _ in range(len(self._others))]
        if not self._steps.get_subscription_count():
            return True
        try:
            self._send(step, others)
        except Exception as error:  # a display must not end a session, whatever it cannot be told
            self._ros.node.get_logger().error(
                f"step {step.index} is not sent to displays: {type(error).__name__}: {error}",
                throttle_duration_sec=1.0,
            )
        return True

    def _send(self, step: StepResult, others: list[TrackedTransform]) -> None:
        sent = {(each.target, each.source, each.stamp.ns) for each in step.frame.poses}
        others = [each for each in others if (each.target, each.source, each.stamp.ns) not in sent]
        origin = StepOrigin(
            self._instance_id,
            self._content_id,
            self._holds.present(),
            time.time_ns(),
            self._text("request", self._requests.last),
            self._text("recording", self._recording()),
            self._image_problem(),
        )
        self._steps.publish(step_message(step, origin, others))

    def note(self, samples: Sequence[TrackedTransform]) -> None:
        """Send ``samples`` with the next step, besides its own: displays place images by them."""
        self._others.extend(samples)

    def prepare(self, content: SessionContent) -> SwitchContent:
        """Find the digests of the surfaces; return the switch, which publishes the description."""
        surfaces = [each.surface for each in content.structures]
        for mesh in (content.tumor, content.tool, *surfaces):
            if mesh is not None:
                mesh_digest(mesh)
        return self._use

    def _use(self, content: SessionContent) -> None:
        session = DescribedSession(content, self._images, self._displays, self._host)
        text = self._wire.description(session)
        self._wire.keep(text)  # not the surfaces of earlier contents
        self._content_id = text_digest(text)
        self._descriptions.publish(
            ContentMessage(
                version=ContentMessage.VERSION,
                instance_id=self._instance_id,
                content_id=self._content_id,
                text=text,
            )
        )

    def _text(self, name: str, value: object) -> str:
        """``value`` as text, written once for each object; empty for None."""
        known, text = self._texts.get(name, (None, ""))
        if value is not known:
            text = "" if value is None else self._wire.text(value)
            self._texts[name] = value, text
        return text

    def _check_mesh(self, request: GetMesh.Request) -> None:
        """Refuse a flood: each surface takes milliseconds of the interpreter's time."""
        self._meshes_limit.admit("mesh", time.monotonic_ns())

    def _get_mesh(self, request: GetMesh.Request, response: GetMesh.Response) -> None:
        mesh = self._wire.meshes.get(request.digest)
        if mesh is None:
            raise BridgeError(
                f"mesh {request.digest[:40]!r}: not one of this session; expected a digest of the "
                "present ~/content"
            )
        write_mesh(mesh, response)
        response.success = True


class CommandService:
    """Serves ``~/command``: the commands of operators at displays, each listed with its display.

    ROS does not tell a service who has sent a request. The request names its node, which must have
    a client of the service: a guard against mistakes, as `OperatorList`. Commands of different
    kinds do not wait for each other.
    """

    def __init__(
        self,
        ros: RosNode,
        commands: OperatorCommands,
        requests: OperatorRequests,
        instance_id: str,
    ) -> None:
        self._ros = ros
        self._commands = commands
        self._requests = requests
        self._instance_id = instance_id
        self._wire, self._reading = SessionWire(), threading.Lock()
        self._server = ServiceServer(
            ros,
            Command,
            COMMAND,
            self._serve,
            in_thread=True,
            check=self._check,
            max_waiting=_MAX_WAITING,
            lane=lambda request: request.command,
        )

    def _check(self, request: Command.Request) -> None:
        """Refuse what is invalid at once, without a thread."""
        kind = command_kind(request.command)
        limit = _MAX_REARM if kind == RequestKind.REARM else _MAX_ARGUMENTS
        with self._requests.refusals(kind, origin_text(request.node)):
            if len(request.arguments) > limit:
                raise BridgeError(
                    f"arguments of {kind}: {len(request.arguments)} characters; expected at most "
                    f"{limit}"
                )
            if request.instance_id != self._instance_id:
                raise BridgeError(
                    "the guard was started again since the display showed it; expected the same "
                    "request again, after a look at it"
                )
            if kind == RequestKind.REARM:
                rearm = self._read(request)
                assert isinstance(rearm, Rearm)
                self._commands.check_rearm(SeenHold(rearm.seq, rearm.nonce))
            if kind != RequestKind.MARGINS:
                self._requests.check(kind, COMMAND)
                return
            margins, in_use = self._read(request), self._commands.content.margins
            assert isinstance(margins, SetMargins)
            requested = in_use.replaced(stop_mm=margins.stop_mm, warn_mm=margins.warn_mm)
            self._requests.check_margins(in_use, requested, COMMAND)

    def _serve(self, request: Command.Request, response: Command.Response) -> None:
        kind, origin = command_kind(request.command), origin_text(request.node)
        with self._requests.refusals(kind, origin):
            self._check_client(request.node)
            command = self._read(request)
        response.message = command.apply(self._commands, origin)
        response.success = True

    def _read(self, request: Command.Request) -> OperatorCommand:
        mesh = _received_mesh(request) if request.digest else None
        with self._reading:
            self._wire.meshes = {} if mesh is None else {request.digest: mesh}
            return self._wire.read_command(request.command, request.arguments)

    def _check_client(self, node: str) -> None:
        """Raise `BridgeError` unless ``node`` has a client of the service."""
        deadline_s = time.monotonic() + _KNOWN_WITHIN_S
        while not self._has_client(node):
            if time.monotonic() > deadline_s:
                raise BridgeError(
                    f"{self._server.name}: the node {node[:80]!r} has no client of it; expected "
                    "the full name of the node that asks"
                )
            threading.Event().wait(_LOOK_S)

    def _has_client(self, node: str) -> bool:
        namespace, _, name = node.rpartition("/")
        place = name, namespace or "/"
        try:
            # Only of a node that is there: rcl rejects other names by errors of its own.
            if place not in self._ros.node.get_node_names_and_namespaces():
                return False
            found = self._ros.node.get_client_names_and_types_by_node(*place)
        except NodeNameNonExistentError:  # it has left
            return False
        return any(service == self._server.name for service, _ in found)


def _received_mesh(request: Command.Request) -> SurfaceMesh:
    """The surface of ``request``. Raises `BridgeError` for a size or digest that is not its own."""
    triangles, vertices = len(request.triangles), len(request.vertices)
    if not 0 < triangles <= 3 * MAX_LIVE_TRIANGLES or vertices > 9 * MAX_LIVE_TRIANGLES:
        raise BridgeError(
            f"the surface has {triangles // 3} triangles and {vertices // 3} vertices; expected "
            f"1 to {MAX_LIVE_TRIANGLES} triangles in a live session: reduce its resolution"
        )
    mesh = received_mesh(request.frame_id, request.vertices, request.triangles)
    if mesh_digest(mesh) != request.digest:
        raise BridgeError("the surface has another digest than the request; expected its own")
    return mesh
