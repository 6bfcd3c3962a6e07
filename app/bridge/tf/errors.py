"""Errors of the transform buffer, named as in tf2."""

from app.bridge.errors import BridgeError


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
