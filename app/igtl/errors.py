"""What can be wrong with bytes that come over OpenIGTLink."""

from app.geometry import MarginGuardError


class IgtlError(MarginGuardError):
    """An OpenIGTLink server cannot be reached as asked."""


class IgtlFramingError(IgtlError):
    """Bytes that begin no message: where the next one begins is not known any more."""


class IgtlChecksumError(IgtlError):
    """A body that is not what its header says was sent."""


class IgtlContentError(IgtlError):
    """A body whose parts do not fit into it, or into each other."""


class IgtlStampError(IgtlError):
    """A message that does not tell when it was measured."""


class IgtlLimitError(IgtlError):
    """More of something than an operating room has."""
