"""Errors of calls to other nodes."""

from typing import Any

from app.bridge.errors import BridgeError


class CallError(BridgeError):
    """Base class: a call to another node failed."""


class ServerUnavailableError(CallError):
    """No server was discovered within the timeout."""


class ServerGoneError(CallError):
    """The server left the graph before it replied."""


class CallTimeoutError(CallError):
    """The server is available but did not reply within the timeout."""


class CallCancelledError(CallError):
    """The caller cancelled the call."""


class RefusedError(CallError):
    """The server refused the request; the message contains its reason."""


class ParameterUnsetError(CallError):
    """The node has not declared the parameter or has not set its value."""


class GoalRejectedError(RefusedError):
    """The action server rejected the goal."""


class GoalEndedError(CallError):
    """Base class: a goal ended without success; ``result`` is the server's result."""

    def __init__(self, message: str, result: Any) -> None:
        super().__init__(message)
        self.result = result


class GoalAbortedError(GoalEndedError):
    """The server aborted the goal."""


class GoalCancelledError(GoalEndedError):
    """The goal was cancelled on request."""
