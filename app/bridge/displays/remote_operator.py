"""Requests of displays to a live node: names of its services and clients, surfaces, commands."""

import threading
from array import array
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from marginguard_msgs.msg import SessionStep
from marginguard_msgs.srv import Command

from app.bridge.calls.service_client import ServiceClient
from app.bridge.node import RosNode
from app.bridge.ros_errors import BridgeError
from app.geometry import SurfaceMesh
from app.hold import SeenHold
from app.runtime import (
    OperatorCommand,
    OperatorRequest,
    RecordingStatus,
    RequestKind,
    SessionContent,
    SessionWire,
)

GET_MESH = "~/get_mesh"
COMMAND = "~/command"

PAGE_NODE = "marginguard_page"
PANEL_NODE = "marginguard_panel"
API_NODE = "marginguard_api"

_DISPLAYS = {PAGE_NODE: "the page", PANEL_NODE: "the panel", API_NODE: "the Python API"}

REPLY_S, LONG_REPLY_S = 10.0, 120.0
"""Longest wait for a command; for those of `_LONG`, which take seconds."""
_LONG = frozenset({RequestKind.TUMOR, RequestKind.STRUCTURE, RequestKind.RECORD})

_Value = TypeVar("_Value")


def origin_text(node: str) -> str:
    """The origin under which requests of the node with this full name are listed.

    >>> origin_text("/marginguard_page_7")
    'the page (/marginguard_page_7)'
    """
    name = node.rpartition("/")[2]
    display = next((text for prefix, text in _DISPLAYS.items() if name.startswith(prefix)), "ROS")
    return f"{display} ({node[:80]})"


def write_mesh(mesh: SurfaceMesh, message: Any) -> None:
    """Write ``mesh`` into a reply of ``~/get_mesh`` or a request of ``~/command``."""
    message.frame_id = mesh.frame
    message.vertices = array("d", mesh.vertices_mm.tobytes())
    message.triangles = array("I", mesh.faces.astype(np.uint32).tobytes())


def received_mesh(frame: str, vertices_mm: "array[float]", triangles: "array[int]") -> SurfaceMesh:
    """The surface of `write_mesh`. Raises `BridgeError` for lengths that are no multiple of 3."""
    if len(vertices_mm) % 3 or len(triangles) % 3:
        raise BridgeError(
            f"surface: {len(vertices_mm)} coordinates and {len(triangles)} indices; expected "
            "multiples of 3"
        )
    return SurfaceMesh(
        frame,
        np.array(vertices_mm, dtype=np.float64).reshape(-1, 3),
        np.array(triangles, dtype=np.int32).reshape(-1, 3),
    )


class RemoteOperator:
    """`app.runtime.Operator` of a session in another process."""

    def __init__(
        self,
        ros: RosNode,
        service: str,
        content: SessionContent,
        compute: Callable[..., Any],
    ) -> None:
        self._ros, self._service = ros, service
        self._compute = compute
        self.content = content
        """The content of the last step."""
        self._instance_id = ""
        self._wire = SessionWire()
        self._client: ServiceClient | None = None
        self._creating = threading.Lock()
        self._texts = ("", "")
        self._seen = SeenHold(0, 0)
        self.last_request: OperatorRequest | None = None
        """The request that the session has listed last; None before any."""
        self.recording: RecordingStatus | None = None
        """State of the last recording of the session; None before the first."""

    def follow(self, content: SessionContent, message: SessionStep) -> None:
        """Use what came with a step."""
        self.content = content
        self._seen = SeenHold(message.hold_seq, message.hold_nonce)
        self._instance_id = message.instance_id
        texts = message.request, message.recording
        if texts != self._texts:
            self._texts = texts
            request, recording = texts
            value = self._wire.value
            self.last_request = value(OperatorRequest, request) if request else None
            self.recording = value(RecordingStatus, recording) if recording else None

    def seen(self) -> SeenHold:
        """Identifies the hold of the last step."""
        return self._seen

    def request(self, command: OperatorCommand) -> str:
        """Send ``command`` and wait until it is carried out.

        Raises `BridgeError` with the node's reason where it refuses. The service's client is made
        with the first command: a display that only shows sends none.
        """
        wire = SessionWire()
        arguments = wire.command(command)
        request = Command.Request(
            node=self._ros.node.get_fully_qualified_name(),
            instance_id=self._instance_id,
            command=command.kind,
            arguments=arguments,
        )
        for digest, mesh in wire.meshes.items():
            request.digest = digest
            write_mesh(mesh, request)
        wait_s = LONG_REPLY_S if command.kind in _LONG else REPLY_S
        reply = self._connected().call(request, wait_s)
        if not reply.success:
            raise BridgeError(reply.message)
        return str(reply.message)

    def compute(self, function: Callable[..., _Value], /, *args: Any) -> _Value:
        """Return ``function(*args)``, computed in a process of low priority."""
        result: _Value = self._compute(function, *args)
        return result

    def _connected(self) -> ServiceClient:
        with self._creating:
            if self._client is None:
                self._client = ServiceClient(self._ros, Command, self._service)
            return self._client
