"""Actions of other nodes, which SlicerROS2 has not, followed without holding up the scene."""

import threading
from typing import Any

from slicer import vtkMRMLScriptedModuleNode

from app.bridge.calls import ActionClient, CallError, GoalEndedError
from app.bridge.convert import action_type, type_name
from app.geometry import MarginGuardError
from app.runtime.latest_value import LatestValue
from ROS2Lib.errors import Ros2Error
from ROS2Lib.member import Member, Owner
from ROS2Lib.ros_message import message_of, value_of

_TIMEOUT_S = 3600.0
_CANCEL_S = 3.0
"""For the server to hear that its goal is not wanted any more, before the client leaves."""


class _Goal:
    """One goal under way, in a thread that follows it to its end."""

    def __init__(self, client: ActionClient, goal: Any, timeout_s: float) -> None:
        self.result: Any = None
        self.error = ""
        self.feedback: LatestValue[Any] = LatestValue()
        self.done = threading.Event()
        self.cancel = threading.Event()
        self._work = (client, goal, timeout_s)
        threading.Thread(target=self._run, name=f"goal of {client.name}", daemon=True).start()

    def _run(self) -> None:
        client, goal, timeout_s = self._work
        try:
            self.result = client.call(goal, timeout_s, self.cancel, feedback=self.feedback.put)
        except CallError as error:
            self.error = str(error)
            self.result = error.result if isinstance(error, GoalEndedError) else None
        self.done.set()


class vtkMRMLROS2ActionClientNode(Member, vtkMRMLScriptedModuleNode):
    """``ModifiedEvent`` comes in `Spin` when there is new feedback, and when the goal has ended."""

    ROLE = "action client"
    KIND = ""

    def __init__(self) -> None:
        self._type = action_type(self.KIND)
        self._client: ActionClient | None = None
        self._action = ""
        self._goal: _Goal | None = None
        self._feedback: Any = None
        self._result: Any = None
        self._error = "no goal was sent"
        self._timeout_s = _TIMEOUT_S

    def GetAction(self) -> str:
        """The name as it was given."""
        return self._action

    def GetROSType(self) -> str:
        """``marginguard_msgs/action/Replay``."""
        return type_name(self._type)

    def CreateBlankGoal(self) -> Any:
        """A goal to be filled in and sent."""
        return value_of(self._type.Goal())

    def SendAsyncGoal(self, goal: Any) -> None:
        """Send a goal; raises `MarginGuardError` for another type, and while one is under way."""
        if self._client is None:
            raise Ros2Error(f"{self.GetName()}: the action client is not on a ROS node")
        if self._goal is not None:
            raise Ros2Error(f"{self._action}: a goal is under way, cancel it first")
        message = message_of(goal, self._type.Goal)
        self._feedback = self._result = None
        self._error = "the goal is under way"
        self._goal = _Goal(self._client, message, self._timeout_s)

    def CancelGoal(self) -> bool:
        """Ask for the end of the goal; False when none is under way."""
        if self._goal is None:
            return False
        self._goal.cancel.set()
        return True

    def IsGoalInProgress(self) -> bool:
        """Whether a goal is under way, or its end waits for `Spin`."""
        return self._goal is not None

    def GetLastFeedback(self) -> Any:
        """The newest feedback to the last goal; None while there is none."""
        return self._feedback

    def GetLastResult(self) -> Any:
        """What came of the last goal, also of one that was given up; None while nothing has."""
        return self._result

    def GetLastResultStatus(self) -> bool:
        """Whether the last goal was reached."""
        return self._error == ""

    def GetLastError(self) -> str:
        """Why it was not, or not yet; else empty."""
        return self._error

    def SetTimeoutSeconds(self, seconds: float) -> None:
        """How long a goal may take from now on, the search for its server included."""
        if not 0.0 < seconds <= 1e6:
            raise Ros2Error(f"{self.GetName()}: a timeout of {seconds} s: 0 to 1e6 s wanted")
        self._timeout_s = seconds

    def status(self) -> str:
        """How the last goal went."""
        return f"{self.GetROSType()}, {self._error or 'reached'}"

    @classmethod
    def key(cls, owner: Owner, *names: str) -> tuple[str, ...]:
        """The action, however it was spelt."""
        return (owner.resolve(names[0]),)

    def spin(self) -> None:
        """Take feedback and end in."""
        goal = self._goal
        if goal is None:
            return
        is_done = goal.done.is_set()
        feedback = goal.feedback.take(0.0)
        if feedback is not None:
            self._feedback = value_of(feedback)
        if is_done:
            self._goal, self._error = None, goal.error
            if goal.result is not None:
                try:
                    self._result = value_of(goal.result)
                except MarginGuardError as error:
                    self._error = str(error)
        if is_done or feedback is not None:
            self.Modified()

    def _start(self, owner: Owner, action: str) -> None:
        self._client = ActionClient(owner.ros, self._type, action)
        self._action = action
        self.SetName(f"ros2:action:client:{action}")
        self.SetModuleName("ROS2")

    def _stop(self) -> None:
        client, self._client = self._client, None
        goal, self._goal = self._goal, None
        if goal is not None:
            goal.cancel.set()
            goal.done.wait(_CANCEL_S)
        if client is not None and self._owner is not None:
            self._owner.ros.remove_on_close(client.close)
            self._owner.ros.call(client.close)
