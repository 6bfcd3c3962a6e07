"""Action client: send goals to another node, wait for their results, cancel them."""

import threading
from collections.abc import Callable, Mapping
from typing import Any

from action_msgs.msg import GoalStatus
from rclpy.action.client import ActionClient as RosActionClient
from rclpy.action.client import ClientGoalHandle
from rclpy.task import Future

from app.bridge.calls.service_client import (
    DEFAULT_TIMEOUT_S,
    SENDING_ERRORS,
    Deadline,
    PendingReply,
    is_served,
    wait_for_server,
)
from app.bridge.convert.plain import action_type, from_plain
from app.bridge.node import RosNode
from app.bridge.ros_errors import (
    BridgeError,
    CallCancelledError,
    CallError,
    CallTimeoutError,
    GoalAbortedError,
    GoalCancelledError,
    GoalRejectedError,
    RefusedError,
    ServerGoneError,
    reason_of,
)

_CANCEL_TIMEOUT_S = 2.0
"""Timeout of the cancel request that `ActionClient.call` sends when its caller gives up."""


class Goal:
    """A goal that the server has accepted. Created by `ActionClient.start` only."""

    def __init__(self, client: "ActionClient", handle: ClientGoalHandle) -> None:
        self._client = client
        self._handle = handle
        # Requested at once because a server discards results after a while.
        future = client.send(handle.get_result_async)
        self._result = client.pending_reply(future, "result")

    @property
    def is_done(self) -> bool:
        """True if `result` returns or raises at once."""
        return self._result.is_done

    def result(self, timeout_s: float, cancel: threading.Event | None = None) -> Any:
        """Wait for the result of the goal and return it.

        Raises `GoalAbortedError` or `GoalCancelledError`, each with the server's result,
        `CallTimeoutError` (the goal continues; call again), `ServerGoneError`, and
        `CallCancelledError` when ``cancel`` is set.
        """
        reply = self._result.result(timeout_s, cancel)
        name = self._client.name
        reason = str(getattr(reply.result, "message", "")) or "no reason given"
        if reply.status == GoalStatus.STATUS_SUCCEEDED:
            return reply.result
        if reply.status == GoalStatus.STATUS_ABORTED:
            raise GoalAbortedError(f"action {name} was aborted: {reason}", reply.result)
        if reply.status == GoalStatus.STATUS_CANCELED:
            raise GoalCancelledError(f"action {name} was cancelled: {reason}", reply.result)
        raise ServerGoneError(f"action {name}: the server no longer knows the goal")

    def cancel(self, timeout_s: float = DEFAULT_TIMEOUT_S) -> None:
        """Request cancellation; `result` then reports how the goal ended.

        Returns when the server has accepted the request or the goal has already ended. Raises
        `RefusedError` when the server rejects the request, `CallTimeoutError`, `ServerGoneError`.
        """
        if self.is_done:
            return
        deadline = Deadline(timeout_s)
        future = self._client.send(self._handle.cancel_goal_async)
        reply = self._client.pending_reply(future, "cancel").result(deadline.remaining_s)
        if not reply.goals_canceling and not self.is_done:
            # The goal ended before the request arrived; `result` reports how.
            if reply.return_code == reply.ERROR_GOAL_TERMINATED:
                return
            raise RefusedError(f"action {self._client.name}: the server refused to cancel the goal")


class ActionClient:
    """``ActionClient(ros, "marginguard_msgs/action/Replay", "/marginguard/replay").call(goal)``.

    A goal that the server accepts after the caller's timeout is cancelled.
    """

    def __init__(self, ros: RosNode, action: str | type, name: str) -> None:
        self.type = action_type(action)
        self._ros = ros
        try:
            self._client = RosActionClient(ros.node, self.type, name)
        except Exception as error:  # rclpy has an unrelated type for each way to be invalid
            raise CallError(f"no client for an action {name!r}: {reason_of(error)}") from error
        self.name = str(ros.node.resolve_topic_name(name))
        self._closed = False
        ros.on_close(self.close)

    @property
    def is_available(self) -> bool:
        """True if an action server is discovered."""
        return not self._closed and is_served(self._ros, self._client.server_is_ready)

    def wait(self, timeout_s: float, cancel: threading.Event | None = None) -> None:
        """Wait for an action server; raises `ServerUnavailableError`."""
        self._wait(Deadline(timeout_s, cancel))

    def start(
        self,
        goal: Any,
        timeout_s: float = DEFAULT_TIMEOUT_S,
        cancel: threading.Event | None = None,
        *,
        feedback: Callable[[Any], None] | None = None,
    ) -> Goal:
        """Send ``goal`` and wait up to ``timeout_s`` until the server has accepted it.

        The goal is a ROS message (lengths in m) or a mapping of plain values (lengths in mm).
        ``feedback(message)`` is called in the node's thread. Raises `GoalRejectedError`,
        `ServerUnavailableError`, `ServerGoneError`, `CallTimeoutError`, `CallCancelledError`.
        """
        if isinstance(goal, Mapping):
            goal = from_plain(self.type.Goal, goal)
        if not isinstance(goal, self.type.Goal):
            raise CallError(
                f"{self.name}: the goal is a {type(goal).__name__}; "
                f"expected {self.type.__name__}.Goal or a mapping"
            )
        deadline = Deadline(timeout_s, cancel)
        self._wait(deadline)

        def on_feedback(message: Any) -> None:
            if feedback is not None:
                feedback(message.feedback)

        future = self.send(
            lambda: self._client.send_goal_async(goal, feedback_callback=on_feedback)
        )
        pending = self.pending_reply(
            future, "goal", abandon=lambda: self._cancel_if_accepted(future)
        )
        try:
            handle = pending.result(deadline.remaining_s, cancel)
        finally:
            pending.cancel()  # does nothing when the reply has arrived
        if not handle.accepted:
            raise GoalRejectedError(f"action {self.name} rejected the goal")
        return Goal(self, handle)

    def call(
        self,
        goal: Any,
        timeout_s: float,
        cancel: threading.Event | None = None,
        *,
        feedback: Callable[[Any], None] | None = None,
    ) -> Any:
        """Send ``goal`` and return its result; cancels the goal on timeout and on ``cancel``."""
        deadline = Deadline(timeout_s, cancel)
        started = self.start(goal, timeout_s, cancel, feedback=feedback)
        try:
            return started.result(deadline.remaining_s, cancel)
        except (CallTimeoutError, CallCancelledError):
            try:
                started.cancel(_CANCEL_TIMEOUT_S)
            except CallError as error:
                self._ros.node.get_logger().warning(f"{error}; the goal continues unattended")
            raise

    def send(self, request: Callable[[], Future]) -> Future:
        """Call ``request()`` in the node's thread and return its future.

        rclpy registers a request after sending it, without a lock. From another thread the node's
        thread could receive the reply first and drop it. Raises `CallError`.
        """
        futures: list[Future] = []
        reasons: list[str] = []

        def send_now() -> None:
            try:
                if not (self._closed or reasons):
                    futures.append(request())
            except SENDING_ERRORS as error:
                reasons.append(reason_of(error))

        try:
            self._ros.call(send_now)
        except BridgeError as error:
            reasons.append(str(error))
        if not futures:
            reason = reasons[0] if reasons else "the client is closed"
            raise CallError(f"action {self.name}: cannot send the request: {reason}")
        return futures[0]

    def pending_reply(
        self, future: Future, what: str, *, abandon: Callable[[], None] = lambda: None
    ) -> PendingReply:
        """Wrap the ``future`` of a reply of one of the action's services."""
        return PendingReply(
            self._ros,
            future,
            f"{what} of action {self.name}",
            is_available=lambda: self.is_available,
            abandon=abandon,
        )

    def close(self) -> None:
        """Destroy the client; running goals continue unattended. Idempotent."""
        if not self._closed:
            self._closed = True
            self._client.destroy()

    def _wait(self, deadline: Deadline) -> None:
        what = f"action {self.name}"
        wait_for_server(self._ros, lambda: self.is_available, what, deadline)

    def _cancel_if_accepted(self, future: Future) -> None:
        def cancel(future: Future) -> None:
            handle = future.result()
            if handle is not None and handle.accepted:
                handle.cancel_goal_async()
                self._ros.node.get_logger().warning(
                    f"action {self.name}: cancelled a goal that was accepted after the caller's "
                    "timeout"
                )

        future.add_done_callback(cancel)
