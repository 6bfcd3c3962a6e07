"""Quality of service in words, as a configuration file has it."""

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
_MOST_DEPTH = 10_000


def quality(
    *, depth: int = 10, reliability: str = "reliable", durability: str = "volatile"
) -> QoSProfile:
    """Keep the last ``depth`` messages; ``transient_local`` is what ROS users call latched."""
    if not 1 <= depth <= _MOST_DEPTH:
        raise ConversionError(f"depth {depth} of a topic: 1 to {_MOST_DEPTH} wanted")
    if reliability not in _RELIABILITY:
        raise ConversionError(f"reliability {reliability!r}: {' or '.join(_RELIABILITY)} wanted")
    if durability not in _DURABILITY:
        raise ConversionError(f"durability {durability!r}: {' or '.join(_DURABILITY)} wanted")
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=_RELIABILITY[reliability],
        durability=_DURABILITY[durability],
    )
