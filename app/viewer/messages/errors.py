"""Errors of messages that a page sends."""

from app.viewer.errors import ViewerError


class MessageError(ViewerError):
    """The message has no meaning here; no page sends it. The connection is closed."""


class RefusedError(ViewerError):
    """The request is not one that this page may make. It is answered with this text."""
