"""Actions of ours: the work is done in a thread of its own, and every goal ends in a known way."""

import threading
from collections.abc import Callable
from enum import Enum, auto
from typing import Any

from rclpy.action.server import ActionServer as RosActionServer
from rclpy.action.server import CancelResponse, GoalResponse, ServerGoalHandle
from rclpy.serialization import serialize_message
from rclpy.task import Future

from app.bridge.calls.errors import CallError
from app.bridge.calls.service_server import failed
from app.bridge.convert.types import action_type
from app.bridge.errors import reason_of
from app.bridge.node import RosNode
from app.geometry import MarginGuardError

_END_S = 10.0
"""How long a goal's work may take to notice, at the end, that it was cancelled."""

_RESULT_KEPT_S = 60
"""How long a result may be asked for; rclpy's 900 s let a flood of goals fill the memory."""

_ROUNDS = 3
"""rclpy sends a result two rounds of the executor after the work on its goal has ended."""


class Ending(Enum):
    """How the work on a goal ended."""

    SUCCEEDED = auto()
    ABORTED = auto()
    CANCELLED = auto()


class ServedGoal:
    """What the work on a goal sees of it; made by `ActionServer` alone."""

    def __init__(self, handle: ServerGoalHandle) -> None:
        self.request = handle.request
        self.cancelled = threading.Event()
        self._handle = handle
        self._stop: Callable[[], None] | None = None

    def feedback(self, message: Any) -> None:
        """Tell whoever follows the goal how far it is."""
        self._handle.publish_feedback(message)

    def on_cancel(self, stop: Callable[[], None]) -> None:
        """Call ``stop()`` once the goal is cancelled, from the node's thread or, if it is, now."""
        self._stop = stop
        if self.cancelled.is_set():
            stop()

    def cancel(self) -> None:
        """Tell the work to stop."""
        self.cancelled.set()
        if self._stop is not None:
            self._stop()


class ActionServer:
    """Serve the action ``name``, one goal at a time.

    ``check(goal)`` runs in the node's thread, quickly, and raises `MarginGuardError` to reject a
    goal (the reason goes to the log: ROS has no field for it). ``run(served)`` does the work in a
    thread of its own and returns the result with how it ended. What it raises aborts the goal,
    with the reason in the result's ``message`` where the type has one, and is counted: in
    `refused` when it is a `MarginGuardError`, in `failures` otherwise. Cancelling is always
    granted: ``served.cancelled`` is set, and the work has to look.

    When the node is closed the goal under way is cancelled and its result still sent.
    """

    def __init__(
        self,
        ros: RosNode,
        action: str | type,
        name: str,
        run: Callable[[ServedGoal], tuple[Any, Ending]],
        *,
        check: Callable[[Any], None] = lambda goal: None,
    ) -> None:
        self.type = action_type(action)
        self.rejected = 0
        self.refused = 0
        self.failures = 0
        self._ros = ros
        self._run = run
        self._check = check
        self._closing = False
        self._goals: dict[bytes, ServedGoal] = {}
        try:
            self._server = RosActionServer(
                ros.node,
                self.type,
                name,
                self._execute,
                goal_callback=self._asked,
                handle_accepted_callback=self._accepted,
                cancel_callback=self._cancel,
                result_timeout=_RESULT_KEPT_S,
            )
        except Exception as error:  # rclpy has an unrelated type for each way to be invalid
            raise CallError(f"no action {name!r}: {reason_of(error)}") from error
        self.name = str(ros.node.resolve_topic_name(name))
        self._idle = threading.Event()
        self._idle.set()
        ros.on_close(self.close)

    def close(self) -> None:
        """Cancel the goal under way, wait until its result is out, stop serving."""
        if self._closing:
            return
        self._closing = True
        for served in tuple(self._goals.values()):
            served.cancel()
        if not self._idle.wait(_END_S):
            self._ros.node.get_logger().error(f"action {self.name}: its work does not end")
        for _ in range(_ROUNDS):
            around = threading.Event()
            self._ros.call_soon(around.set)
            around.wait(_END_S)
        self._server.destroy()

    def _asked(self, goal: Any) -> GoalResponse:
        reason = ""
        if self._goals or self._closing:
            reason = "a goal is under way"
        else:
            try:
                self._check(goal)
            except MarginGuardError as error:
                reason = str(error)
            except Exception as error:  # the caller must have an answer
                self.failures += 1
                reason = f"the check failed: {type(error).__name__}: {error}"
        if reason:
            self.rejected += 1
            self._ros.node.get_logger().warning(
                f"action {self.name}: goal rejected: {reason}", throttle_duration_sec=1.0
            )
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def _accepted(self, handle: ServerGoalHandle) -> None:
        # Not earlier: a goal whose sender has gone is accepted and never comes here.
        self._idle.clear()
        self._goals[bytes(handle.goal_id.uuid)] = ServedGoal(handle)
        handle.execute()

    def _cancel(self, handle: ServerGoalHandle) -> CancelResponse:
        served = self._goals.get(bytes(handle.goal_id.uuid))
        if served is None:
            return CancelResponse.REJECT
        served.cancel()
        return CancelResponse.ACCEPT

    async def _execute(self, handle: ServerGoalHandle) -> Any:
        """Run in the node's thread, which goes on with other things until the work is done."""
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
            if ending is Ending.CANCELLED and handle.is_cancel_requested:
                handle.canceled()
            elif ending is Ending.SUCCEEDED:
                handle.succeed()
            else:
                handle.abort()
        finally:
            self._idle.set()
        return result

    def _outcome(self, served: ServedGoal) -> tuple[Any, Ending]:
        try:
            result, ending = self._run(served)
            serialize_message(result)  # one that cannot be sent would be none
        except MarginGuardError as error:
            self.refused += 1
            return failed(self.type.Result(), str(error)), Ending.ABORTED
        except Exception as error:  # whatever it is, the goal must end
            self.failures += 1
            words = f"{type(error).__name__}: {error}"
            self._ros.node.get_logger().error(f"action {self.name} failed: {words}")
            return failed(self.type.Result(), f"the server failed: {words}"), Ending.ABORTED
        return result, ending
