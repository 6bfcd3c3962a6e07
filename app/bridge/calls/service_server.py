"""Services of ours that always answer: a handler that fails says so to its caller."""

import threading
from collections.abc import Callable
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.serialization import serialize_message
from rclpy.task import Future

from app.bridge.calls.errors import CallError
from app.bridge.convert.types import service_type
from app.bridge.errors import reason_of
from app.bridge.node import RosNode
from app.geometry import MarginGuardError


class ServiceServer:
    """Answer ``name`` by ``handle(request, response)``, which fills in the response it is given.

    It runs in the node's thread and must not wait for another call; with ``in_thread`` it runs in
    one of its own, one request at a time, the next being refused meanwhile. rclpy leaves a caller
    without a reply when a handler raises. Here the reply is a fresh response, whose ``success``
    stays false and whose ``message`` is the reason where the type has such fields. A refusal
    (`MarginGuardError`) is counted in `refused`; anything else in `failures`, and in the log.
    """

    def __init__(
        self,
        ros: RosNode,
        service: str | type,
        name: str,
        handle: Callable[[Any, Any], None],
        *,
        in_thread: bool = False,
    ) -> None:
        self.type = service_type(service)
        self.refused = 0
        self.failures = 0
        self._ros = ros
        self._handle = handle
        self._busy = False  # seen by the node's thread alone
        try:
            self._service = ros.node.create_service(
                self.type,
                name,
                self._answer_later if in_thread else self._answer,
                # The default group would hold back all of the node until the thread is done.
                callback_group=ReentrantCallbackGroup() if in_thread else None,
            )
        except Exception as error:  # rclpy has an unrelated type for each way to be invalid
            raise CallError(f"no service {name!r}: {reason_of(error)}") from error
        self.name = str(self._service.service_name)

    def close(self) -> None:
        """Stop serving."""
        if self._ros.is_open:
            self._ros.node.destroy_service(self._service)

    async def _answer_later(self, request: Any, response: Any) -> Any:
        if self._busy:
            self.refused += 1
            return failed(response, f"{self.name} is busy with an earlier request")
        self._busy = True
        done = Future()

        def work() -> None:
            done.set_result(self._answer(request, response))
            self._ros.wake()

        threading.Thread(target=work, name=f"service {self.name}", daemon=True).start()
        answer = await done
        self._busy = False
        return answer

    def _answer(self, request: Any, response: Any) -> Any:
        try:
            self._handle(request, response)
            serialize_message(response)  # one that cannot be sent would be no answer either
        except MarginGuardError as error:
            self.refused += 1
            return failed(self.type.Response(), str(error))
        except Exception as error:  # whatever it is, the caller must have an answer
            self.failures += 1
            words = f"{type(error).__name__}: {error}"
            self._ros.node.get_logger().error(f"service {self.name} failed: {words}")
            return failed(self.type.Response(), f"the server failed: {words}")
        return response


def failed(message: Any, reason: str) -> Any:
    """A reply or result of blank values with ``reason`` in it, where it has a field for that."""
    if isinstance(getattr(message, "message", None), str):
        message.message = reason.encode("utf-8", "replace").decode("utf-8")
    return message
