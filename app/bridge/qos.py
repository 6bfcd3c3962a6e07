"""The promises that a publisher of ours makes about delivery, and what our readers ask for.

* ``STREAM``: reliable, volatile, the last 100. tf's own; whoever joins late gets what follows.
* ``NEWEST``: reliable, volatile, the last one. For a controller: never an old constraint first,
  and never one from before it joined, which is why this one is *not* latched.
* ``LATCHED``: reliable, transient-local, the last one. Whoever joins late gets it at once.

Three are for readers. ``INCOMING`` is for what strangers send: reliable, the last 20, which is a
tenth of a second of a tracker, or a burst of one sample for each of 20 tools. The middleware keeps
room for so many messages as large as the largest that ever came, so the depth is what bounds our
memory. ``STATIC_TF`` hears what every static broadcaster has latched, not the last one alone;
``ANY_CLOCK`` hears players that promise nothing, as they mostly do.
"""

from dataclasses import dataclass

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy


def _reliable(depth: int, durability: DurabilityPolicy) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=durability,
    )


STREAM = _reliable(100, DurabilityPolicy.VOLATILE)
NEWEST = _reliable(1, DurabilityPolicy.VOLATILE)
LATCHED = _reliable(1, DurabilityPolicy.TRANSIENT_LOCAL)
INCOMING = _reliable(20, DurabilityPolicy.VOLATILE)
STATIC_TF = _reliable(20, DurabilityPolicy.TRANSIENT_LOCAL)
ANY_CLOCK = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=10,  # the last time before a jump is what tells that it was one
    reliability=ReliabilityPolicy.BEST_EFFORT,
    durability=DurabilityPolicy.VOLATILE,
)


@dataclass(frozen=True, slots=True, eq=False)
class Topic:
    """A topic's name (``~`` is the node's own name), its message type and its promise."""

    name: str
    type: type
    qos: QoSProfile
