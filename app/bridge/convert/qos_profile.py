"""QoS profiles from the names of their policies."""

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from app.bridge.convert.errors import ConversionError

_RELIABILITY = {
    "reliable": ReliabilityPolicy.RELIABLE,
    "best_effort": ReliabilityPolicy.BEST_EFFORT,
}
_DURABILITY = {
    "volatile": DurabilityPolicy.VOLATILE,
    "transient_local": DurabilityPolicy.TRANSIENT_LOCAL,
}
_MAX_DEPTH = 10_000


def qos_profile(
    *, depth: int = 10, reliability: str = "reliable", durability: str = "volatile"
) -> QoSProfile:
    """QoS profile that keeps the last ``depth`` messages; ``transient_local`` means latched.

    Raises `ConversionError` for an unknown policy and a depth out of range.
    """
    if not 1 <= depth <= _MAX_DEPTH:
        raise ConversionError(f"depth is {depth}; expected 1 to {_MAX_DEPTH}")
    if reliability not in _RELIABILITY:
        raise ConversionError(
            f"reliability is {reliability!r}; expected {' or '.join(_RELIABILITY)}"
        )
    if durability not in _DURABILITY:
        raise ConversionError(f"durability is {durability!r}; expected {' or '.join(_DURABILITY)}")
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=_RELIABILITY[reliability],
        durability=_DURABILITY[durability],
    )
