"""Clients and servers for parameters, services and actions. Every call has a timeout."""

from app.bridge.calls.action_client import ActionClient, Goal
from app.bridge.calls.action_server import ActionServer, GoalOutcome, ServedGoal
from app.bridge.calls.parameter_client import ParameterChange, ParameterClient
from app.bridge.calls.parameter_server import ParameterDeclaration, ParameterServer
from app.bridge.calls.service_client import PendingReply, ServiceClient
from app.bridge.calls.service_server import ServiceServer
from app.bridge.ros_errors import (
    CallCancelledError,
    CallError,
    CallTimeoutError,
    GoalAbortedError,
    GoalCancelledError,
    GoalEndedError,
    GoalRejectedError,
    ParameterUnsetError,
    RefusedError,
    ServerGoneError,
    ServerUnavailableError,
)

__all__ = [
    "ActionClient",
    "ActionServer",
    "CallCancelledError",
    "CallError",
    "CallTimeoutError",
    "Goal",
    "GoalAbortedError",
    "GoalCancelledError",
    "GoalEndedError",
    "GoalOutcome",
    "GoalRejectedError",
    "ParameterChange",
    "ParameterClient",
    "ParameterDeclaration",
    "ParameterServer",
    "ParameterUnsetError",
    "PendingReply",
    "RefusedError",
    "ServedGoal",
    "ServerGoneError",
    "ServerUnavailableError",
    "ServiceClient",
    "ServiceServer",
]
