"""Action server that executes each goal in a separate thread and always sends a result."""

import threading
import time
from collections.abc import Callable
from enum import Enum, auto
from typing import Any

from action_msgs.msg import GoalStatusArray
from rclpy.action.server import ActionServer as RosActionServer
from rclpy.action.server import CancelResponse, GoalResponse, ServerGoalHandle
from rclpy.qos import qos_profile_action_status_default
from rclpy.serialization import serialize_message
from rclpy.task import Future

from app.bridge.calls.service_server import failure_reply
from app.bridge.convert.plain import action_type
from app.bridge.node import RosNode
from app.bridge.ros_errors import CallError, reason_of
from app.bridge.topics import Topic
from app.geometry import MarginGuardError

_CLOSE_TIMEOUT_S = 10.0
"""Longest time for which `ActionServer.close` waits until the cancelled goal has ended."""

_RESULT_TIMEOUT_S = 60
"""Time that a result is kept; with rclpy's default of 900 s many goals would fill the memory."""

_REQUEST_TIMEOUT_S = 2.0
"""Longest time after the end of a goal for which `ActionServer.close` waits for the request of its
result. A client sends it when it has received the goal's acceptance; some clients never do."""


class GoalOutcome(Enum):
    """Terminal state of a goal."""

    SUCCEEDED = auto()
    ABORTED = auto()
    CANCELLED = auto()


class ServedGoal:
    """A goal that is being executed. Created by `ActionServer` only."""

    def __init__(self, handle: ServerGoalHandle) -> None:
        self.request = handle.request
        self.cancelled = threading.Event()
        self._handle = handle
        self._stop: Callable[[], None] | None = None

    def feedback(self, message: Any) -> None:
        """Publish a feedback message."""
        self._handle.publish_feedback(message)

    def on_cancel(self, stop: Callable[[], None]) -> None:
        """Call ``stop()`` in the node's thread on cancellation; now if already cancelled."""
        self._stop = stop
        if self.cancelled.is_set():
            stop()

    def cancel(self) -> None:
        """Set `cancelled` and call the function given to `on_cancel`."""
        self.cancelled.set()
        if self._stop is not None:
            self._stop()


class _ResultServer(RosActionServer):
    """rclpy's server; `result_sent` is set while no accepted goal waits for its result."""

    def __init__(self, *args: Any, **options: Any) -> None:
        self.result_sent = threading.Event()
        self.result_sent.set()
        super().__init__(*args, **options)  # type: ignore[no-untyped-call]

    def _send_result_response(self, request_header: Any, future: Future) -> None:
        super()._send_result_response(request_header, future)  # type: ignore[no-untyped-call]
        self.result_sent.set()


class ActionServer:
    """Serve the action ``name``, one goal at a time.

    ``check(goal)`` runs in the node's thread and must not block. It raises `MarginGuardError` to
    reject a goal; the reason is logged because ROS has no field for it. ``run(served)`` executes
    the goal in a separate thread and returns the result and its outcome. An exception aborts the
    goal and is written to the result's ``message`` if the type has that field. It is counted in
    `refused` if it is a `MarginGuardError`, otherwise in `failures`. Cancel requests are always
    accepted: they set ``served.cancelled``, which ``run`` must check.

    Closing the node cancels the active goal and still sends its result: it stops serving when the
    client has requested the result and has received it, or 2 s after the end of the goal.
    """

    def __init__(
        self,
        ros: RosNode,
        action: str | type,
        name: str,
        run: Callable[[ServedGoal], tuple[Any, GoalOutcome]],
        *,
        check: Callable[[Any], None] = lambda goal: None,
    ) -> None:
        self.type = action_type(action)
        self.refused = 0
        self.failures = 0
        self._ros = ros
        self._run = run
        self._check = check
        self._closing = False
        self._goals: dict[bytes, ServedGoal] = {}
        try:
            self._server = _ResultServer(
                ros.node,
                self.type,
                name,
                self._execute,
                goal_callback=self._on_goal,
                handle_accepted_callback=self._on_accepted,
                cancel_callback=self._on_cancel,
                result_timeout=_RESULT_TIMEOUT_S,
            )
        except Exception as error:  # rclpy has an unrelated type for each way to be invalid
            raise CallError(f"action {name!r} cannot be served: {reason_of(error)}") from error
        # A second publisher of the statuses: rclpy can wait for acknowledgements of a publisher
        # only, not of the replies and messages of an action server.
        self._statuses = ros.publisher(
            Topic(f"{name}/_action/status", GoalStatusArray, qos_profile_action_status_default)
        )
        self._served_any = False
        self._ended_s = 0.0
        self.name = str(ros.node.resolve_topic_name(name))
        self._idle = threading.Event()
        self._idle.set()
        ros.on_close(self.close)

    @property
    def is_active(self) -> bool:
        """True while a goal is executed."""
        return bool(self._goals)

    def close(self) -> None:
        """Cancel the active goal, wait until its result is sent, stop serving."""
        if self._closing:
            return
        self._closing = True
        for served in tuple(self._goals.values()):
            served.cancel()
        if not self._idle.wait(_CLOSE_TIMEOUT_S):
            self._ros.node.get_logger().error(
                f"action {self.name}: the cancelled goal does not end"
            )
        elif self._served_any:
            self._wait_until_result_is_received()
        self._server.destroy()  # type: ignore[no-untyped-call]

    def _wait_until_result_is_received(self) -> None:
        """Wait, with limits, until the client of the last goal has its result.

        A client drops a reply that it receives after it has noticed that the server has left.
        Replies are not acknowledged to rclpy, but messages are. The client receives both through
        one queue, so it has received the result when it acknowledges a later message: an empty
        list of statuses, as of a server without goals.
        """
        due_s = self._ended_s + _REQUEST_TIMEOUT_S
        if self._server.result_sent.wait(max(0.0, due_s - time.monotonic())):
            self._statuses.publish(GoalStatusArray())
            self._ros.flush()

    def _on_goal(self, goal: Any) -> GoalResponse:
        reason = ""
        if self._goals or self._closing:
            reason = "another goal is active"
        else:
            try:
                self._check(goal)
            except MarginGuardError as error:
                reason = str(error)
            except Exception as error:  # the caller must get a reply
                self.failures += 1
                reason = f"the check failed: {type(error).__name__}: {error}"
        if reason:
            self._ros.node.get_logger().warning(
                f"action {self.name}: goal rejected: {reason}", throttle_duration_sec=1.0
            )
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def _on_accepted(self, handle: ServerGoalHandle) -> None:
        # Not in `_on_goal`: a goal whose sender has left is accepted but never gets here.
        self._idle.clear()
        self._server.result_sent.clear()
        self._served_any = True
        self._goals[bytes(handle.goal_id.uuid)] = ServedGoal(handle)
        handle.execute()

    def _on_cancel(self, handle: ServerGoalHandle) -> CancelResponse:
        served = self._goals.get(bytes(handle.goal_id.uuid))
        if served is None:
            return CancelResponse.REJECT
        served.cancel()
        return CancelResponse.ACCEPT

    async def _execute(self, handle: ServerGoalHandle) -> Any:
        """Coroutine of the node's thread; suspends until the worker thread has finished."""
        key = bytes(handle.goal_id.uuid)
        served = self._goals[key]
        if self._closing:
            served.cancel()
        done = Future()

        def work() -> None:
            done.set_result(self._outcome(served))
            self._ros.wake()

        threading.Thread(target=work, name=f"action {self.name}", daemon=True).start()
        result, ending = await done
        del self._goals[key]
        try:
            if ending is GoalOutcome.CANCELLED and handle.is_cancel_requested:
                handle.canceled()
            elif ending is GoalOutcome.SUCCEEDED:
                handle.succeed()
            else:
                handle.abort()
        finally:
            self._ended_s = time.monotonic()
            self._idle.set()
        return result

    def _outcome(self, served: ServedGoal) -> tuple[Any, GoalOutcome]:
        try:
            result, ending = self._run(served)
            serialize_message(result)  # an invalid result must fail here, not when it is sent
        except MarginGuardError as error:
            self.refused += 1
            return failure_reply(self.type.Result(), str(error)), GoalOutcome.ABORTED
        except Exception as error:  # any failure must end the goal
            self.failures += 1
            reason = f"{type(error).__name__}: {error}"
            self._ros.node.get_logger().error(f"action {self.name} failed: {reason}")
            result = failure_reply(self.type.Result(), f"the server failed: {reason}")
            return result, GoalOutcome.ABORTED
        return result, ending
