"""Non-blocking action clients, an addition to SlicerROS2's interface."""

from typing import Any

from slicer import vtkMRMLScriptedModuleNode

from app.bridge.calls import ActionClient
from app.bridge.convert import action_type
from app.geometry import MarginGuardError
from app.runtime.thread_handover import LatestValue
from ROS2Lib.member import ClientMember, Owner, PendingCall, Ros2Error
from ROS2Lib.ros_message import message_of, value_of

_TIMEOUT_S = 3600.0
_CANCEL_TIMEOUT_S = 3.0
"""Time for the server to receive the cancellation before the client leaves the graph."""


class vtkMRMLROS2ActionClientNode(ClientMember, vtkMRMLScriptedModuleNode):
    """Action client. `Spin` invokes ``ModifiedEvent`` on new feedback and at the goal's end."""

    ROLE = "action client"

    def __init__(self) -> None:
        self._type = action_type(self.KIND)
        self._client: ActionClient | None = None
        self._action = ""
        self._goal: PendingCall | None = None
        self._received: LatestValue[Any] = LatestValue()
        self._feedback: Any = None
        self._result: Any = None
        self._error = "no goal was sent"
        self._timeout_s = _TIMEOUT_S

    def GetAction(self) -> str:
        """The action's name as given."""
        return self._action

    def CreateBlankGoal(self) -> Any:
        """An empty goal to fill in and send."""
        return value_of(self._type.Goal())

    def SendAsyncGoal(self, goal: Any) -> None:
        """Send a goal; raises `MarginGuardError` for another type or while a goal is active."""
        if self._client is None or self._owner is None:
            raise Ros2Error(f"{self.GetName()}: the action client is not on a ROS node")
        if self._goal is not None:
            raise Ros2Error(f"{self._action}: a goal is under way; cancel it first")
        message = message_of(goal, self._type.Goal)
        self._feedback = self._result = None
        self._error = "the goal is under way"
        client, wake, timeout_s = self._client, self._owner.wake, self._timeout_s
        received: LatestValue[Any] = LatestValue()

        def take(feedback: Any) -> None:
            received.put(feedback)
            wake()

        self._received = received
        self._goal = PendingCall(
            f"goal of {client.name}",
            lambda cancel: client.call(message, timeout_s, cancel, feedback=take),
            wake,
        )

    def CancelGoal(self) -> bool:
        """Request cancellation of the active goal; False if there is none."""
        if self._goal is None:
            return False
        self._goal.cancel.set()
        return True

    def IsGoalInProgress(self) -> bool:
        """True while a goal is active or its result waits for `Spin`."""
        return self._goal is not None

    def GetLastFeedback(self) -> Any:
        """The newest feedback on the last goal; None before the first."""
        return self._feedback

    def GetLastResult(self) -> Any:
        """Result of the last goal, even if it was cancelled or aborted; None without a result."""
        return self._result

    def GetLastResultStatus(self) -> bool:
        """True if the last goal succeeded."""
        return self._error == ""

    def status(self) -> str:
        """Type and outcome of the last goal."""
        return f"{self.GetROSType()}, {self._error or 'reached'}"

    def spin(self) -> None:
        """Transfer feedback and result into the node."""
        goal = self._goal
        if goal is None:
            return
        is_done = goal.done.is_set()
        feedback = self._received.take(0.0)
        if feedback is not None:
            self._feedback = value_of(feedback)
        if is_done:
            self._goal, self._error = None, goal.error
            if goal.reply is not None:
                try:
                    self._result = value_of(goal.reply)
                except MarginGuardError as error:
                    self._error = str(error)
        if is_done or feedback is not None:
            self.Modified()

    def _start(self, owner: Owner, action: str) -> None:
        self._client = ActionClient(owner.ros, self._type, action)
        self._action = action
        self.SetName(f"ros2:action:client:{action}")

    def _stop(self) -> None:
        client, self._client = self._client, None
        goal, self._goal = self._goal, None
        if goal is not None:
            goal.cancel.set()
            goal.done.wait(_CANCEL_TIMEOUT_S)
        if client is not None and self._owner is not None:
            self._owner.ros.remove_on_close(client.close)
            self._owner.ros.call(client.close)
