"""The promises that a publisher of ours makes about delivery, and what our readers ask for.

* ``STREAM``: reliable, volatile, the last 100. tf's own; whoever joins late gets what follows.
* ``NEWEST``: reliable, volatile, the last one. For a controller: never an old constraint first,
  and never one from before it joined, which is why this one is *not* latched.
* ``LATCHED``: reliable, transient-local, the last one. Whoever joins late gets it at once.

Four are for readers. ``INCOMING`` is for poses and joints that strangers send a live session: best
effort, which hears those that promise nothing (most drivers' sensor data) and those that promise
delivery alike. A reliable reader hands over nothing that came after a gap before the gap is filled,
by a stranger's writer seconds later; here the newest counts, and what is lost is stale by its own
stamp. The last 20 are a tenth of a second of a tracker, or a burst of one sample for each of 20
tools. The middleware keeps room for so many messages as large as the largest that ever came, so the
depth is what bounds our memory. ``INCOMING_TF`` is tf2's own, but for the depth: an edge that was
sent once must not be missed by whoever looks it up for ever after. ``STATIC_TF`` hears what every
static broadcaster has latched, not the last one alone; ``ANY_CLOCK`` hears players that promise
nothing, as they mostly do.
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


def _best_effort(depth: int) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.VOLATILE,
    )


STREAM = _reliable(100, DurabilityPolicy.VOLATILE)
NEWEST = _reliable(1, DurabilityPolicy.VOLATILE)
LATCHED = _reliable(1, DurabilityPolicy.TRANSIENT_LOCAL)
INCOMING = _best_effort(20)
INCOMING_TF = _reliable(20, DurabilityPolicy.VOLATILE)
STATIC_TF = _reliable(20, DurabilityPolicy.TRANSIENT_LOCAL)
ANY_CLOCK = _best_effort(10)  # the last time before a jump is what tells that it was one


@dataclass(frozen=True, slots=True, eq=False)
class Topic:
    """A topic's name (``~`` is the node's own name), its message type and its promise."""

    name: str
    type: type
    qos: QoSProfile
