"""Errors of messages that a page sends."""

from app.viewer.errors import ViewerError


class MessageError(ViewerError):
    """The message has no meaning here; no page sends it. The connection is closed."""


class RefusedError(ViewerError):
    """The request is not one that this page may make. It is answered with this text."""


class NotDoneError(RefusedError):
    """A request that this page may make, but that cannot be done now.

    It is answered with this text and does not count among the page's refused requests.
    """
