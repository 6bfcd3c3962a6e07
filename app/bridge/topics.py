"""Published and subscribed topics with their quality of service.

``/tf`` is volatile in every ROS system: a subscriber that joins during a replay receives the
latched static tree at once, and moving edges from the next frame on.

Profiles of publishers:

* ``STREAM``: reliable, volatile, depth 100, as tf2 uses. Late subscribers get only what follows.
* ``NEWEST``: reliable, volatile, depth 1. For controllers: it never delivers an outdated
  constraint, and none from before the subscription, so it is *not* latched.
* ``LATCHED``: reliable, transient local, depth 1. Late subscribers get the last message at once.

Profiles of subscriptions:

* ``INCOMING``: best effort, depth 20, for poses and joints of external publishers in a live
  session. Best effort matches both best-effort publishers (most sensor drivers) and reliable ones.
  A reliable subscription would withhold newer messages until a lost one is resent, possibly
  seconds later. Here only the newest sample matters, and a lost one becomes stale by its own
  stamp. 20 messages are a tenth of a second of a tracker, or one sample of each of 20 tools. The
  middleware reserves memory for as many messages of the largest size received, so the depth
  bounds it.
* ``DISPLAYED``: best effort, depth 100: a display that stalls does not delay the guard.
* ``POLLED``: reliable, depth 20, for a controller that takes the constraints of 1 kHz at its steps:
  those of a second guard, too, because the depth is that of all publishers together.
* ``INCOMING_IMAGE``: best effort, depth 1: only the newest image is shown.
* ``INCOMING_TF``: as tf2, with depth 20. Reliable, because an edge that is sent once must arrive.
* ``STATIC_TF``: transient local with depth 20, to receive the latched message of every static
  broadcaster.
* ``ANY_CLOCK``: best effort, because most players publish ``/clock`` as best effort.
"""

from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TwistStamped, WrenchStamped
from marginguard_msgs.msg import FixtureConstraint, SessionContent, SessionStep
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import ColorRGBA, Float64, String
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import MarkerArray


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
POLLED = _reliable(20, DurabilityPolicy.VOLATILE)
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


TF = Topic("/tf", TFMessage, STREAM)
"""Measured edges, robot links and the virtual fixture, each with the stamp of its sample."""

TF_STATIC = Topic("/tf_static", TFMessage, LATCHED)
"""Calibrations and the registered robot base, in one message."""

JOINT_STATES = Topic("/joint_states", JointState, STREAM)
"""Every joint sample of the recording, on the tracker's clock."""

ROBOT_DESCRIPTION = Topic("/robot_description", String, LATCHED)
"""The unchanged text of the URDF file."""

CONSTRAINT = Topic("~/constraint", FixtureConstraint, NEWEST)
"""Constraint of the virtual fixture; repeated as a heartbeat between steps."""

STEP = Topic("~/step", SessionStep, STREAM)
"""Every step of a live session with what displays show of it."""

CONTENT = Topic("~/content", SessionContent, LATCHED)
"""Description of a live session for its steps: names, frames, margins, surfaces by digest."""

DESIRED_TWIST = Topic("~/desired_twist", TwistStamped, NEWEST)
"""Input: desired twist of the tool's tip in m/s and rad/s, along the axes of the header's frame."""

ALLOWED_TWIST = Topic("~/allowed_twist", TwistStamped, NEWEST)
"""Reply to each desired twist: the nearest twist that the constraint allows."""

GUIDANCE_WRENCH = Topic("~/guidance_wrench", WrenchStamped, NEWEST)
"""Guidance force at the tool's tip in N and N m; published if guidance is configured."""

MARGIN_MM = Topic("~/margin_mm", Float64, STREAM)
"""Signed distance in mm; NaN while it is unknown."""

MARGIN_COLOR = Topic("~/margin_color", ColorRGBA, LATCHED)
"""The colour of the margin state."""

MARKERS = Topic("~/markers", MarkerArray, LATCHED)
"""Meshes of tumour and tool and the text of the margin, by two publishers: see `PreparedShapes`."""

CLOCK = Topic("/clock", Clock, NEWEST)
"""The player's time, for nodes with ``use_sim_time``."""

DIAGNOSTICS = Topic("/diagnostics", DiagnosticArray, STREAM)
"""State, reasons, ages and lost poses, at every change and once per second of player time."""

PLAYBACK = Topic("/marginguard_tracker/playback", String, LATCHED)
"""Announces a playback of a recording: its case and provenance. See `app.bridge.playback`."""

EXECUTED_PLAN = Topic("/marginguard_execute/plan", String, LATCHED)
"""The plan that an arm executes now, as JSON; empty while it executes none. For displays."""

MOTION = (
    *(
        f"{way}_{space}"
        for way in ("servo", "move", "interpolate")
        for space in ("jv", "jp", "jr", "jf", "cp", "cr", "cv", "cf")
    ),
    "servo_ci",
    "body/servo_cf",
    "spatial/servo_cf",
)
"""Inputs of CRTK, in the namespace of an arm, that move it. One node alone may send on them."""

EVERY_STEP = (
    TF,
    JOINT_STATES,
    CONSTRAINT,
    MARGIN_MM,
    MARGIN_COLOR,
    MARKERS,
    CLOCK,
    DIAGNOSTICS,
)
"""Topics that are published at every step."""
