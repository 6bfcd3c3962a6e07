"""Services that the scene answers, which SlicerROS2 has not."""

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


class _Asked:
    """A request, from the ROS side, that waits for `spin`."""

    def __init__(self, request: Any) -> None:
        self.request = request
        self.response: Any = None
        self.error = ""
        self.over = threading.Event()


class vtkMRMLROS2ServiceServerNode(Member, vtkMRMLScriptedModuleNode):
    """Calls ``handler(request, response)`` in `Spin`, where it may touch the scene.

    Both have ``Get`` and ``Set`` for each field; the handler fills the response in. One request at
    a time. Who asks is told when the handler fails, or when no spin has answered within 5 s.
    """

    ROLE = "service server"
    KIND = ""

    def __init__(self) -> None:
        self._type = service_kind(self.KIND)
        self._server: ServiceServer | None = None
        self._handler: Handler | None = None
        self._service = ""
        self._asked: _Asked | None = None
        self._answered = 0

    def SetHandler(self, handler: Handler) -> None:
        """What answers; before it is added to a ROS node."""
        self._handler = handler

    def GetService(self) -> str:
        """The name as it was given."""
        return self._service

    def GetROSType(self) -> str:
        """``std_srvs/srv/Trigger``."""
        return type_name(self._type)

    def GetNumberOfRequests(self) -> int:
        """How many the handler has answered."""
        return self._answered

    def status(self) -> str:
        """How many requests it has answered."""
        return f"{self.GetROSType()}, {self._answered} answered"

    @classmethod
    def key(cls, owner: Owner, *names: str) -> tuple[str, ...]:
        """The service, however it was spelt."""
        return (owner.resolve(names[0]),)

    def spin(self) -> None:
        """Have the request that waits answered."""
        asked, self._asked = self._asked, None
        if asked is None or asked.over.is_set() or self._handler is None:
            return
        response = value_of(self._type.Response())
        try:
            self._handler(value_of(asked.request), response)
            asked.response = message_of(response, self._type.Response)
            self._answered += 1
        except Exception as error:  # the script's, whatever it is: who asked must hear of it
            asked.error = f"{type(error).__name__}: {error}"
            logging.exception(f"{self.GetName()}: the handler failed")
        asked.over.set()

    def _start(self, owner: Owner, service: str) -> None:
        if self._handler is None:
            raise Ros2Error(f"service {service!r}: a handler is wanted")
        self._server = ServiceServer(owner.ros, self._type, service, self._answer, in_thread=True)
        self._service = service
        self.SetName(f"ros2:srv:server:{service}")
        self.SetModuleName("ROS2")

    def _stop(self) -> None:
        server, self._server = self._server, None
        asked, self._asked = self._asked, None
        if asked is not None:
            asked.error = "the service has ended"
            asked.over.set()
        if server is not None and self._owner is not None:
            self._owner.ros.call(server.close)

    def _answer(self, request: Any, response: Any) -> None:
        """In the server's thread: have `spin` answer."""
        asked = _Asked(request)
        self._asked = asked
        if not asked.over.wait(_TIMEOUT_S):
            asked.over.set()
            raise Ros2Error(f"{self._service}: no spin has answered within {_TIMEOUT_S:g} s")
        if asked.error:
            raise Ros2Error(asked.error)
        for field in response.get_fields_and_field_types():
            setattr(response, field, getattr(asked.response, field))
