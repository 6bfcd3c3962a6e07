"""Errors of converting messages."""

from app.bridge.errors import BridgeError


class UnknownTypeError(BridgeError):
    """The name is not a message, service or action type, or the type is not installed."""


class ConversionError(BridgeError):
    """The value does not fit its field."""
