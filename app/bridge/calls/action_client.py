"""Goals for an action of another node: sent, followed, cancelled, and ended in a known way."""

import threading
from collections.abc import Callable, Mapping
from typing import Any

from action_msgs.msg import GoalStatus
from rclpy.action.client import ActionClient as RosActionClient
from rclpy.action.client import ClientGoalHandle
from rclpy.task import Future

from app.bridge.calls.errors import (
    CallCancelledError,
    CallError,
    CallTimeoutError,
    GoalAbortedError,
    GoalCancelledError,
    GoalRejectedError,
    RefusedError,
    ServerGoneError,
)
from app.bridge.calls.pending import Pending
from app.bridge.calls.waiting import (
    DEFAULT_TIMEOUT_S,
    SENDING_ERRORS,
    Deadline,
    ServerWait,
    is_served,
)
from app.bridge.convert.plain import from_plain
from app.bridge.convert.types import action_type
from app.bridge.errors import BridgeError, reason_of
from app.bridge.node import RosNode

_CANCEL_S = 2.0
"""How long a goal that is not wanted any more may take to be told so."""


class Goal:
    """A goal that the server has taken on; made by `ActionClient.start` alone."""

    def __init__(self, client: "ActionClient", handle: ClientGoalHandle) -> None:
        self._client = client
        self._handle = handle
        # Asked for at once: a server keeps results for a while only.
        future = client.sent(handle.get_result_async)
        self._result = client.pending(future, "result")

    @property
    def is_done(self) -> bool:
        """Whether `result` returns, or raises, at once."""
        return self._result.is_done

    def result(self, timeout_s: float, cancel: threading.Event | None = None) -> Any:
        """What came of it.

        Raises `GoalAbortedError` and `GoalCancelledError` with the result that the server gave
        along, `CallTimeoutError` (the goal goes on, ask again), `ServerGoneError`, and
        `CallCancelledError` when ``cancel`` ended the wait.
        """
        reply = self._result.result(timeout_s, cancel)
        name = self._client.name
        said = str(getattr(reply.result, "message", "")) or "it gave no reason"
        if reply.status == GoalStatus.STATUS_SUCCEEDED:
            return reply.result
        if reply.status == GoalStatus.STATUS_ABORTED:
            raise GoalAbortedError(f"action {name} was aborted: {said}", reply.result)
        if reply.status == GoalStatus.STATUS_CANCELED:
            raise GoalCancelledError(f"action {name} was cancelled: {said}", reply.result)
        raise ServerGoneError(f"action {name}: the server does not know the goal any more")

    def cancel(self, timeout_s: float = DEFAULT_TIMEOUT_S) -> None:
        """Ask the server to stop; the way it ends is told by `result`.

        Returns when the server has agreed, or when the goal is over already; raises `RefusedError`
        when it goes on, `CallTimeoutError`, `ServerGoneError`.
        """
        if self.is_done:
            return
        limit = Deadline(timeout_s)
        future = self._client.sent(self._handle.cancel_goal_async)
        reply = self._client.pending(future, "cancel").result(limit.remaining_s)
        if not reply.goals_canceling and not self.is_done:
            # A goal that ends meanwhile is not there to be cancelled: its result tells.
            if reply.return_code == reply.ERROR_GOAL_TERMINATED:
                return
            raise RefusedError(f"action {self._client.name} does not let its goal be cancelled")


class ActionClient:
    """``ActionClient(ros, "marginguard_msgs/action/Replay", "/marginguard/replay").call(goal)``.

    A goal that is taken on after its caller gave up is cancelled and counted in `late_goals`:
    nobody would follow it.
    """

    def __init__(self, ros: RosNode, action: str | type, name: str) -> None:
        self.type = action_type(action)
        self._ros = ros
        try:
            self._client = RosActionClient(ros.node, self.type, name)
        except Exception as error:  # rclpy has an unrelated type for each way to be invalid
            raise CallError(f"no client for an action {name!r}: {reason_of(error)}") from error
        self.name = str(ros.node.resolve_topic_name(name))
        self.late_goals = 0
        self._server = ServerWait(ros, lambda: self.is_there, f"action {self.name}")
        self._closed = False
        ros.on_close(self.close)

    @property
    def is_there(self) -> bool:
        """Whether somebody serves it now."""
        return not self._closed and is_served(self._ros, self._client.server_is_ready)

    def wait(self, timeout_s: float, cancel: threading.Event | None = None) -> None:
        """Return once somebody serves it; raises `NotThereError`."""
        self._server.wait(Deadline(timeout_s, cancel))

    def start(
        self,
        goal: Any,
        timeout_s: float = DEFAULT_TIMEOUT_S,
        cancel: threading.Event | None = None,
        *,
        feedback: Callable[[Any], None] | None = None,
    ) -> Goal:
        """Send ``goal``; returns when the server has taken it on, within ``timeout_s``.

        The goal is a message, as ROS has it, or plain values with lengths in mm.
        ``feedback(message)`` is called in the node's thread. Raises `GoalRejectedError`,
        `NotThereError`, `ServerGoneError`, `CallTimeoutError`, `CallCancelledError`.
        """
        if isinstance(goal, Mapping):
            goal = from_plain(self.type.Goal, goal)
        if not isinstance(goal, self.type.Goal):
            raise CallError(
                f"{self.name}: a {type(goal).__name__} is no goal of {self.type.__name__}"
            )
        limit = Deadline(timeout_s, cancel)
        self._server.wait(limit)

        def said(message: Any) -> None:
            if feedback is not None:
                feedback(message.feedback)

        future = self.sent(lambda: self._client.send_goal_async(goal, feedback_callback=said))
        pending = self.pending(future, "goal", abandon=lambda: self._take_late(future))
        try:
            handle = pending.result(limit.remaining_s, cancel)
        finally:
            pending.cancel()  # does nothing when the answer has come
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
        """The result of ``goal``; a caller that gives up takes the goal back from the server."""
        limit = Deadline(timeout_s, cancel)
        started = self.start(goal, timeout_s, cancel, feedback=feedback)
        try:
            return started.result(limit.remaining_s, cancel)
        except (CallTimeoutError, CallCancelledError):
            try:
                started.cancel(_CANCEL_S)
            except CallError as error:
                self._ros.node.get_logger().warning(f"{error}: it goes on, and nobody follows it")
            raise

    def sent(self, send: Callable[[], Future]) -> Future:
        """What ``send()`` gives in the node's thread; for this client and its goals.

        rclpy notes a request after it was sent, without a lock: in another thread the reply, which
        the node's own takes in, could be faster, and would be thrown away. Raises `CallError`.
        """
        futures: list[Future] = []
        reasons: list[str] = []

        def work() -> None:
            try:
                if not (self._closed or reasons):
                    futures.append(send())
            except SENDING_ERRORS as error:
                reasons.append(reason_of(error))

        try:
            self._ros.call(work)
        except BridgeError as error:
            reasons.append(str(error))
        if not futures:
            reason = reasons[0] if reasons else "the client is closed"
            raise CallError(f"action {self.name}: nothing can be sent: {reason}")
        return futures[0]

    def pending(
        self, future: Future, what: str, *, abandon: Callable[[], None] = lambda: None
    ) -> Pending:
        """A reply of one of the action's services."""
        return Pending(
            self._ros,
            future,
            f"{what} of action {self.name}",
            there=lambda: self.is_there,
            abandon=abandon,
        )

    def close(self) -> None:
        """Leave the graph; goals that are under way are not followed any more. Once is enough."""
        if not self._closed:
            self._closed = True
            self._client.destroy()

    def _take_late(self, future: Future) -> None:
        def taken(future: Future) -> None:
            handle = future.result()
            if handle is not None and handle.accepted:
                self.late_goals += 1
                handle.cancel_goal_async()
                self._ros.node.get_logger().warning(
                    f"action {self.name}: a goal was taken on after its caller had given up: "
                    "cancelled"
                )

        future.add_done_callback(taken)
