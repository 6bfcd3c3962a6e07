"""Parameters, services and actions, as client and as server: every call ends, none silently."""

from app.bridge.calls.action_client import ActionClient, Goal
from app.bridge.calls.action_server import ActionServer, Ending, ServedGoal
from app.bridge.calls.errors import (
    CallCancelledError,
    CallError,
    CallTimeoutError,
    GoalAbortedError,
    GoalCancelledError,
    GoalEndedError,
    GoalRejectedError,
    NotThereError,
    ParameterUnsetError,
    RefusedError,
    ServerGoneError,
)
from app.bridge.calls.parameter_client import (
    ParameterChange,
    ParameterClient,
    ParameterDescription,
)
from app.bridge.calls.parameter_server import ParameterDeclaration, ParameterServer
from app.bridge.calls.pending import Pending
from app.bridge.calls.service_client import ServiceClient
from app.bridge.calls.service_server import ServiceServer

__all__ = [
    "ActionClient",
    "ActionServer",
    "CallCancelledError",
    "CallError",
    "CallTimeoutError",
    "Ending",
    "Goal",
    "GoalAbortedError",
    "GoalCancelledError",
    "GoalEndedError",
    "GoalRejectedError",
    "NotThereError",
    "ParameterChange",
    "ParameterClient",
    "ParameterDeclaration",
    "ParameterDescription",
    "ParameterServer",
    "ParameterUnsetError",
    "Pending",
    "RefusedError",
    "ServedGoal",
    "ServerGoneError",
    "ServiceClient",
    "ServiceServer",
]
