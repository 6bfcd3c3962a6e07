"""What cannot be said as a message."""

from app.bridge.errors import BridgeError


class UnknownTypeError(BridgeError):
    """A name that is no type of message, service or action, or one that is not installed."""


class ConversionError(BridgeError):
    """A value that does not fit the field that it is meant for."""
