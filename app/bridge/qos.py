"""Quality-of-service profiles of our publishers and subscriptions.

Publishers:

* ``STREAM``: reliable, volatile, depth 100, as tf2 uses. Late subscribers get only what follows.
* ``NEWEST``: reliable, volatile, depth 1. For controllers: it never delivers an outdated
  constraint, and none from before the subscription, so it is *not* latched.
* ``LATCHED``: reliable, transient local, depth 1. Late subscribers get the last message at once.

Subscriptions:

* ``INCOMING``: best effort, depth 20, for poses and joints of external publishers in a live
  session. Best effort matches both best-effort publishers (most sensor drivers) and reliable ones.
  A reliable subscription would withhold newer messages until a lost one is resent, possibly
  seconds later. Here only the newest sample matters, and a lost one becomes stale by its own
  stamp. 20 messages are a tenth of a second of a tracker, or one sample of each of 20 tools. The
  middleware reserves memory for as many messages of the largest size received, so the depth
  bounds it.
* ``DISPLAYED``: best effort, depth 100: a display that stalls does not delay the guard.
* ``INCOMING_IMAGE``: best effort, depth 1: only the newest image is shown.
* ``INCOMING_TF``: as tf2, with depth 20. Reliable, because an edge that is sent once must arrive.
* ``STATIC_TF``: transient local with depth 20, to receive the latched message of every static
  broadcaster.
* ``ANY_CLOCK``: best effort, because most players publish ``/clock`` as best effort.
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
DISPLAYED = _best_effort(100)
INCOMING_IMAGE = _best_effort(1)
INCOMING_TF = _reliable(20, DurabilityPolicy.VOLATILE)
STATIC_TF = _reliable(20, DurabilityPolicy.TRANSIENT_LOCAL)
ANY_CLOCK = _best_effort(10)  # a jump is detected by comparing consecutive times


@dataclass(frozen=True, slots=True, eq=False)
class Topic:
    """Name of a topic (``~`` expands to the node's name), its message type and its QoS profile."""

    name: str
    type: type
    qos: QoSProfile
