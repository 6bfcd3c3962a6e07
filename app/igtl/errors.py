"""Errors of the OpenIGTLink client."""

from app.geometry import MarginGuardError


class IgtlError(MarginGuardError):
    """Base class: invalid settings, or the client failed."""


class IgtlFramingError(IgtlError):
    """Invalid header; the start of the next message is unknown."""


class IgtlChecksumError(IgtlError):
    """The body does not match the checksum in the header."""


class IgtlContentError(IgtlError):
    """The sizes of the parts of a body are inconsistent."""


class IgtlStampError(IgtlError):
    """The message has no valid time stamp."""


class IgtlLimitError(IgtlError):
    """A size or a count exceeds its limit."""
