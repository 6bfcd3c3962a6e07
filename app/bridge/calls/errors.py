"""How a call can end without a reply, or with one that says no."""

from typing import Any

from app.bridge.errors import BridgeError


class CallError(BridgeError):
    """Root of what can go wrong with a call to another node."""


class NotThereError(CallError):
    """Nobody served the call within its time."""


class ServerGoneError(CallError):
    """Who had to answer left before it did."""


class CallTimeoutError(CallError):
    """The server is there, and did not answer in time."""


class CallCancelledError(CallError):
    """The caller did not want the reply any more."""


class RefusedError(CallError):
    """The other side said no; the message has its reason."""


class ParameterUnsetError(CallError):
    """A parameter that the node has not declared, or not given a value."""


class GoalRejectedError(RefusedError):
    """The server did not take the goal on."""


class GoalEndedError(CallError):
    """Root of a goal that ended in another way than it should; ``result`` is what came of it."""

    def __init__(self, message: str, result: Any) -> None:
        super().__init__(message)
        self.result = result


class GoalAbortedError(GoalEndedError):
    """The server gave up."""


class GoalCancelledError(GoalEndedError):
    """The server stopped because it was asked to."""
