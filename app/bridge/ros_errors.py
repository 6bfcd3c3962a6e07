"""Errors of the ROS interface."""

from typing import Any

from app.geometry import MarginGuardError


class BridgeError(MarginGuardError):
    """A ROS operation failed, or a value cannot be converted to a message."""


def reason_of(error: BaseException) -> str:
    """Text of a library's error on one line, for use in our own message."""
    return " ".join(str(error).split())


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


class UnknownTypeError(BridgeError):
    """The name is not a message, service or action type, or the type is not installed."""


class ConversionError(BridgeError):
    """The value does not fit its field."""


class TfError(BridgeError):
    """Base class: an insertion or a lookup failed."""


class TfInvalidError(TfError):
    """Invalid sample: not finite, not a rotation, or a frame that is its own parent."""


class TfLookupError(TfError):
    """Unknown frame."""


class TfConnectivityError(TfError):
    """No path between two frames, or an edge that would close a loop."""


class TfExtrapolationError(TfError):
    """Time outside the samples of an edge; the buffer does not extrapolate."""


class FollowError(BridgeError):
    """The settings of a followed robot are invalid."""
