"""Non-blocking service clients, and service servers, an addition to SlicerROS2's interface."""

import logging
import threading
from collections.abc import Callable
from functools import partial
from typing import Any

from slicer import vtkMRMLScriptedModuleNode

from app.bridge.calls import ServiceClient, ServiceServer
from app.geometry import MarginGuardError
from ROS2Lib.kinds import service_classes, service_kind
from ROS2Lib.member import (
    USER_EVENT,
    ClientMember,
    Owner,
    PendingCall,
    Ros2Error,
    TypedMember,
)
from ROS2Lib.ros_message import message_of, value_of

_TIMEOUT_S = 5.0


class vtkMRMLROS2ServiceClientNode(ClientMember, vtkMRMLScriptedModuleNode):
    """Service client. `Spin` invokes ``ModifiedEvent`` when a request is answered or fails.

    It invokes ``ResponseReceivedEvent`` (1054, in older versions ``ServiceModifiedEvent``) after
    it, if there is a response.
    """

    ROLE = "service client"
    ResponseReceivedEvent = ServiceModifiedEvent = USER_EVENT + 54

    def __init__(self) -> None:
        self._type = service_kind(self.KIND)
        self._request_class, self._response_class = service_classes(self.KIND)
        self._client: ServiceClient | None = None
        self._service = ""
        self._call: PendingCall | None = None
        self._response: Any = None
        self._error = "no request was sent"
        self._calls = 0
        self._sent = 0
        self._timeout_s = _TIMEOUT_S

    def GetService(self) -> str:
        """The service's name as given."""
        return self._service

    def GetSlicerTypeIn(self) -> str:
        """Class name of the requests."""
        return self._request_class.GetClassName()

    def GetSlicerTypeOut(self) -> str:
        """Class name of the responses."""
        return self._response_class.GetClassName()

    def PreRequestCheck(self) -> bool:
        """True if a request is sent at once: there is a server, and no request is under way."""
        client = self._client
        return client is not None and self._call is None and client.is_available

    def CreateBlankRequest(self) -> Any:
        """An empty request to fill in and send."""
        return self._request_class()

    def SendAsyncRequest(self, request: Any) -> int:
        """Send a request; returns 1, or 0 with a log line off a ROS node or while one is under way.

        A request waits for a server, up to the timeout. Raises `MarginGuardError` and sends
        nothing for a request of another type.
        """
        self._calls += 1
        message = message_of(request, self._type.Request)
        client, owner = self._client, self._owner
        if client is None or owner is None or self._call is not None:
            reason = "is not on a ROS node" if client is None else "has a request under way"
            logging.error(f"{self.GetName()}: the service client {reason}; nothing was sent")
            return 0
        self._response, self._error = None, "the request is under way"
        self._call = PendingCall(
            f"call of {client.name}", partial(client.call, message, self._timeout_s), owner.wake
        )
        self._sent += 1
        return 1

    def GetLastResponse(self) -> Any:
        """Response to the last request; None without one."""
        return self._response

    def GetLastResponseStatus(self) -> bool:
        """True if the last request was answered."""
        return self._response is not None

    def IsRequestInProgress(self) -> bool:
        """True while a request waits for its response or for the `Spin` that transfers it."""
        return self._call is not None

    def GetNumberOfCalls(self) -> int:
        """Number of calls of `SendAsyncRequest`."""
        return self._calls

    def GetNumberOfRequestsSent(self) -> int:
        """Number of sent requests."""
        return self._sent

    def wait(self, timeout_s: float) -> None:
        """Return when the request has ended, or after ``timeout_s``."""
        if self._call is not None:
            self._call.done.wait(timeout_s)

    def status(self) -> str:
        """Type and outcome of the last request."""
        return f"{self.GetROSType()}, {self._error or 'answered'}"

    def spin(self) -> None:
        """Transfer the response into the node."""
        call = self._call
        if call is not None and call.done.is_set():
            self._call, self._error = None, call.error
            if not call.error:
                try:
                    self._response = self._response_class()
                    self._response.take(call.reply)
                except MarginGuardError as error:
                    self._response, self._error = None, str(error)
            self.Modified()
            if not self._error:
                self.InvokeEvent(self.ResponseReceivedEvent)

    def _start(self, owner: Owner, service: str) -> None:
        self._client = ServiceClient(owner.ros, self._type, service)
        self._service = service
        self.SetName(f"ros2:srv:client:{service}")

    def _stop(self) -> None:
        if self._call is not None:
            self._call.cancel.set()
            self._call = None
        if self._client is not None and self._owner is not None:
            self._owner.ros.call(self._client.close)
        self._client = None


_SERVER_TIMEOUT_S = 5.0

Handler = Callable[[Any, Any], None]


class _PendingRequest:
    """A request from the ROS thread that waits for `spin`."""

    def __init__(self, request: Any) -> None:
        self.request = request
        self.response: Any = None
        self.error = ""
        self.over = threading.Event()


class vtkMRMLROS2ServiceServerNode(TypedMember, vtkMRMLScriptedModuleNode):
    """Calls ``handler(request, response)`` in `Spin`, where it may change the scene.

    Both have ``Get`` and ``Set`` for each field; the handler fills in the response. One request is
    processed at a time. The caller receives an error if the handler fails or if no `Spin` has
    answered within 5 s.
    """

    ROLE = "service server"

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

    def GetNumberOfRequests(self) -> int:
        """Number of answered requests."""
        return self._answered

    def status(self) -> str:
        """Type and number of answered requests."""
        return f"{self.GetROSType()}, {self._answered} answered"

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
        if not pending.over.wait(_SERVER_TIMEOUT_S):
            pending.over.set()
            raise Ros2Error(f"{self._service}: no spin has answered within {_SERVER_TIMEOUT_S:g} s")
        if pending.error:
            raise Ros2Error(pending.error)
        for field in response.get_fields_and_field_types():
            setattr(response, field, getattr(pending.response, field))
