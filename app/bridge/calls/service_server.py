"""Service server that replies even when its handler fails."""

import threading
from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.qos import QoSProfile, qos_profile_services_default
from rclpy.serialization import serialize_message
from rclpy.task import Future

from app.bridge.calls.errors import CallError
from app.bridge.calls.unlocked_service import create_unlocked_service
from app.bridge.convert.types import service_type
from app.bridge.errors import reason_of
from app.bridge.message_definitions import foreign_clients
from app.bridge.node import RosNode
from app.geometry import MarginGuardError


class ServiceServer:
    """Serves ``name``: ``handle(request, response)`` fills in the response.

    ``handle`` runs in the node's thread and must not wait for another call. With ``in_thread`` it
    runs in a separate thread, one request at a time; further requests are refused meanwhile. With
    ``lane`` that is so for requests of the same lane.
    ``check(request)`` runs before in the node's thread and refuses by a `MarginGuardError`: such a
    request takes no thread. While a client with another definition of one of our types is known,
    every request is refused, because a request does not name its sender; not with
    ``any_definition``. Up to ``max_waiting`` requests wait for the node's thread, 10 unless
    it is given. ``received_as`` is a type with the type support of the request but another
    conversion to Python, whose result ``check`` and ``handle`` then get; the request is received
    without the GIL.
    rclpy sends no reply when a handler raises. This class then replies with a new response:
    ``success`` is false and ``message`` is the reason, if the type has these fields. A
    `MarginGuardError` is counted in `refused`; other exceptions are counted in `failures` and
    logged.
    """

    def __init__(
        self,
        ros: RosNode,
        service: str | type,
        name: str,
        handle: Callable[[Any, Any], None],
        *,
        in_thread: bool = False,
        check: Callable[[Any], None] | None = None,
        max_waiting: int | None = None,
        any_definition: bool = False,
        received_as: type | None = None,
        lane: Callable[[Any], str] = lambda request: "",
    ) -> None:
        self.type = service_type(service)
        self.refused = 0
        self.failures = 0
        self._ros = ros
        self._handle = handle
        self._check = check
        self._any_definition = any_definition
        self._lane = lane
        self._busy: set[str] = set()  # used in the node's thread only
        try:
            create = ros.node.create_service
            if received_as is not None:
                create = partial(create_unlocked_service, ros.node, received_as=received_as)
            self._service = create(
                self.type,
                name,
                self._reply_from_thread if in_thread else self._reply,
                qos_profile=_qos(max_waiting),
                # The default group would block the whole node until the thread is done.
                callback_group=ReentrantCallbackGroup() if in_thread else None,
            )
        except Exception as error:  # rclpy has an unrelated type for each way to be invalid
            raise CallError(f"service {name!r} cannot be served: {reason_of(error)}") from error
        self.name = str(self._service.service_name)

    def close(self) -> None:
        """Stop serving."""
        if self._ros.is_open:
            self._ros.node.destroy_service(self._service)

    async def _reply_from_thread(self, request: Any, response: Any) -> Any:
        refusal = self._answer(self._check_all, request)
        if refusal is not None:
            return refusal
        lane = self._lane(request)
        if lane in self._busy:
            self.refused += 1
            return failure_reply(response, f"{self.name} is busy with an earlier request")
        self._busy.add(lane)
        done = Future()

        def work() -> None:
            done.set_result(self._reply(request, response))
            self._ros.wake()

        threading.Thread(target=work, name=f"service {self.name}", daemon=True).start()
        reply = await done
        self._busy.remove(lane)
        return reply

    def _check_all(self, request: Any) -> None:
        self._check_definitions()
        if self._check is not None:
            self._check(request)

    def _check_definitions(self) -> None:
        if self._any_definition:
            return
        foreign = foreign_clients(self._ros.node, self.name, self.type)
        if foreign:
            raise CallError(
                f"{self.name}: {', '.join(sorted(foreign))} has another definition of the request; "
                "expected the marginguard_msgs of this installation on both sides"
            )

    def _reply(self, request: Any, response: Any) -> Any:
        refusal = self._answer(self._handle, request, response)
        if refusal is None:  # an invalid response must fail here, not when it is sent
            refusal = self._answer(serialize_message, response)
        return response if refusal is None else refusal

    def _answer(self, handle: Callable[..., object], *arguments: Any) -> Any:
        """Call ``handle``; return the response for a failure, None if there is none."""
        try:
            handle(*arguments)
        except MarginGuardError as error:
            self.refused += 1
            return failure_reply(self.type.Response(), str(error))
        except Exception as error:  # the caller must get a reply for any failure
            self.failures += 1
            reason = f"{type(error).__name__}: {error}"
            self._ros.node.get_logger().error(f"service {self.name} failed: {reason}")
            return failure_reply(self.type.Response(), f"the server failed: {reason}")
        return None


def _qos(max_waiting: int | None) -> QoSProfile:
    if max_waiting is None:
        return qos_profile_services_default
    return QoSProfile(depth=max_waiting)  # reliable and volatile, as ROS's default


def failure_reply(message: Any, reason: str) -> Any:
    """Set ``reason`` in the ``message`` field of a default response or result, if it has one."""
    if isinstance(getattr(message, "message", None), str):
        message.message = reason.encode("utf-8", "replace").decode("utf-8")
    return message
