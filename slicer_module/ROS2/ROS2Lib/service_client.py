"""Non-blocking service clients."""

import logging
import threading
from collections.abc import Callable
from typing import Any

from slicer import vtkMRMLScriptedModuleNode

from app.bridge.calls import CallError, ServiceClient
from app.bridge.convert import type_name
from app.geometry import MarginGuardError
from ROS2Lib.errors import Ros2Error
from ROS2Lib.kinds import service_classes, service_kind
from ROS2Lib.member import Member, Owner
from ROS2Lib.ros_message import message_of

_TIMEOUT_S = 5.0
_USER_EVENT = 1000
"""VTK's first event number for applications."""


class _Call:
    """One pending request, in a thread that waits for the server and its response."""

    def __init__(
        self, client: ServiceClient, request: Any, timeout_s: float, ended: Callable[[], None]
    ) -> None:
        self.reply: Any = None
        self.error = ""
        self.done = threading.Event()
        self.cancel = threading.Event()
        self._work = (client, request, timeout_s)
        self._ended = ended
        threading.Thread(target=self._run, name=f"call of {client.name}", daemon=True).start()

    def _run(self) -> None:
        client, request, timeout_s = self._work
        try:
            self.reply = client.call(request, timeout_s, self.cancel)
        except CallError as error:
            self.error = str(error)
        self.done.set()
        self._ended()


class vtkMRMLROS2ServiceClientNode(Member, vtkMRMLScriptedModuleNode):
    """Service client. `Spin` invokes ``ModifiedEvent`` when a request is answered or fails.

    It invokes ``ResponseReceivedEvent`` (1054, in older versions ``ServiceModifiedEvent``) after
    it, if there is a response.
    """

    ROLE = "service client"
    KIND = ""
    ResponseReceivedEvent = ServiceModifiedEvent = _USER_EVENT + 54

    def __init__(self) -> None:
        self._type = service_kind(self.KIND)
        self._request_class, self._response_class = service_classes(self.KIND)
        self._client: ServiceClient | None = None
        self._service = ""
        self._call: _Call | None = None
        self._response: Any = None
        self._error = "no request was sent"
        self._calls = 0
        self._sent = 0
        self._timeout_s = _TIMEOUT_S

    def GetService(self) -> str:
        """The service's name as given."""
        return self._service

    def GetROSType(self) -> str:
        """``std_srvs/srv/Trigger``."""
        return type_name(self._type)

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
        self._call = _Call(client, message, self._timeout_s, owner.wake)
        self._sent += 1
        return 1

    def GetLastResponse(self) -> Any:
        """Response to the last request; None without one."""
        return self._response

    def GetLastResponseStatus(self) -> bool:
        """True if the last request was answered."""
        return self._response is not None

    def GetLastError(self) -> str:
        """The reason why the last request has no response (no server, timeout), or empty."""
        return self._error

    def IsRequestInProgress(self) -> bool:
        """True while a request waits for its response or for the `Spin` that transfers it."""
        return self._call is not None

    def SetTimeoutSeconds(self, seconds: float) -> None:
        """Set the timeout of later requests in s, including discovery of the server."""
        if not 0.0 < seconds <= 1e6:
            raise Ros2Error(
                f"{self.GetName()}: timeout is {seconds} s; expected more than 0, at most 1e6"
            )
        self._timeout_s = seconds
        self.save_state()

    def settings(self) -> dict[str, Any]:
        """The timeout."""
        return {"timeout_s": self._timeout_s}

    def apply_settings(self, settings: dict[str, Any]) -> None:
        """Set the timeout."""
        self.SetTimeoutSeconds(float(settings["timeout_s"]))

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

    @classmethod
    def key(cls, owner: Owner, *names: str) -> tuple[str, ...]:
        """The resolved name of the service."""
        return (owner.resolve(names[0]),)

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
        self._cancel_call()
        if self._client is not None and self._owner is not None:
            self._owner.ros.call(self._client.close)
        self._client = None

    def _cancel_call(self) -> None:
        if self._call is not None:
            self._call.cancel.set()
            self._call = None
