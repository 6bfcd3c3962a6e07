"""Service servers, an addition to SlicerROS2's interface."""

import logging
import threading
from collections.abc import Callable
from typing import Any

from slicer import vtkMRMLScriptedModuleNode

from app.bridge.calls import ServiceServer
from app.bridge.convert import type_name
from ROS2Lib.errors import Ros2Error
from ROS2Lib.kinds import service_kind
from ROS2Lib.member import Member, Owner
from ROS2Lib.ros_message import message_of, value_of

_TIMEOUT_S = 5.0

Handler = Callable[[Any, Any], None]


class _PendingRequest:
    """A request from the ROS thread that waits for `spin`."""

    def __init__(self, request: Any) -> None:
        self.request = request
        self.response: Any = None
        self.error = ""
        self.over = threading.Event()


class vtkMRMLROS2ServiceServerNode(Member, vtkMRMLScriptedModuleNode):
    """Calls ``handler(request, response)`` in `Spin`, where it may change the scene.

    Both have ``Get`` and ``Set`` for each field; the handler fills in the response. One request is
    processed at a time. The caller receives an error if the handler fails or if no `Spin` has
    answered within 5 s.
    """

    ROLE = "service server"
    KIND = ""

    def __init__(self) -> None:
        self._type = service_kind(self.KIND)
        self._server: ServiceServer | None = None
        self._handler: Handler | None = None
        self._service = ""
        self._pending: _PendingRequest | None = None
        self._answered = 0

    def SetHandler(self, handler: Handler) -> None:
        """Set the handler, before the node is added to a ROS node."""
        self._handler = handler

    def GetService(self) -> str:
        """The service's name as given."""
        return self._service

    def GetROSType(self) -> str:
        """``std_srvs/srv/Trigger``."""
        return type_name(self._type)

    def GetNumberOfRequests(self) -> int:
        """Number of answered requests."""
        return self._answered

    def status(self) -> str:
        """Type and number of answered requests."""
        return f"{self.GetROSType()}, {self._answered} answered"

    @classmethod
    def key(cls, owner: Owner, *names: str) -> tuple[str, ...]:
        """The resolved name of the service."""
        return (owner.resolve(names[0]),)

    def spin(self) -> None:
        """Answer the pending request."""
        pending, self._pending = self._pending, None
        if pending is None or pending.over.is_set() or self._handler is None:
            return
        response = value_of(self._type.Response())
        try:
            self._handler(value_of(pending.request), response)
            pending.response = message_of(response, self._type.Response)
            self._answered += 1
        except Exception as error:  # any error of the script must reach the caller
            pending.error = f"{type(error).__name__}: {error}"
            logging.exception(f"{self.GetName()}: the handler failed")
        pending.over.set()

    def _start(self, owner: Owner, service: str) -> None:
        if self._handler is None:
            raise Ros2Error(f"service {service!r} has no handler; expected SetHandler before")
        self._server = ServiceServer(owner.ros, self._type, service, self._answer, in_thread=True)
        self._service = service
        self.SetName(f"ros2:srv:server:{service}")

    def _stop(self) -> None:
        server, self._server = self._server, None
        pending, self._pending = self._pending, None
        if pending is not None:
            pending.error = "the service has ended"
            pending.over.set()
        if server is not None and self._owner is not None:
            self._owner.ros.call(server.close)

    def _answer(self, request: Any, response: Any) -> None:
        """Wait for `spin` to answer. Runs in the server's thread."""
        pending = _PendingRequest(request)
        self._pending = pending
        if self._owner is not None:
            self._owner.wake()
        if not pending.over.wait(_TIMEOUT_S):
            pending.over.set()
            raise Ros2Error(f"{self._service}: no spin has answered within {_TIMEOUT_S:g} s")
        if pending.error:
            raise Ros2Error(pending.error)
        for field in response.get_fields_and_field_types():
            setattr(response, field, getattr(pending.response, field))
