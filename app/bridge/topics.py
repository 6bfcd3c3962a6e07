"""Published and subscribed topics with their quality of service.

``/tf`` is volatile in every ROS system: a subscriber that joins during a replay receives the
latched static tree at once, and moving edges from the next frame on.
"""

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TwistStamped, WrenchStamped
from marginguard_msgs.msg import FixtureConstraint, SessionContent, SessionStep
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import ColorRGBA, Float64, String
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import MarkerArray

from app.bridge.qos import LATCHED, NEWEST, STREAM, Topic

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
"""Meshes of tumour and tool and the text of the margin, from two publishers: see `Markers`."""

CLOCK = Topic("/clock", Clock, NEWEST)
"""The player's time, for nodes with ``use_sim_time``."""

DIAGNOSTICS = Topic("/diagnostics", DiagnosticArray, STREAM)
"""State, reasons, ages and lost poses, at every change and once per second of player time."""

PLAYBACK = Topic("/marginguard_tracker/playback", String, LATCHED)
"""Announces a playback of a recording: its case and provenance. See `app.bridge.playback`."""

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
