"""What a buffer of transforms cannot answer, each under the name that tf2 has made known."""

from app.bridge.errors import BridgeError


class TfError(BridgeError):
    """Root of what the buffer refuses or cannot answer."""


class TfInvalidError(TfError):
    """A sample that is not one: not finite, no rotation, a frame that is its own parent."""


class TfLookupError(TfError):
    """A frame that nobody has named yet."""


class TfConnectivityError(TfError):
    """Two frames without a way between them, or an edge that would close a loop."""


class TfExtrapolationError(TfError):
    """A time before the first or after the last sample on the way: nothing is extrapolated."""
