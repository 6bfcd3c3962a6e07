"""What a replay publishes, and with which quality of service: one table for code and readers.

``/tf`` is volatile in every ROS system: a subscriber that joins in the middle of a replay has the
static tree at once (latched) and the moving edges from its first frame on, not those before.
"""

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TwistStamped, WrenchStamped
from marginguard_msgs.msg import FixtureConstraint
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import ColorRGBA, Float64, String
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import MarkerArray

from app.bridge.qos import LATCHED, NEWEST, STREAM, Topic

TF = Topic("/tf", TFMessage, STREAM)
"""Measured edges, robot links and the virtual fixture, each with the stamp of its own sample."""

TF_STATIC = Topic("/tf_static", TFMessage, LATCHED)
"""Calibrations and the registered robot base, all in one message."""

JOINT_STATES = Topic("/joint_states", JointState, STREAM)
"""Every joint sample of the recording, on the tracker's clock."""

ROBOT_DESCRIPTION = Topic("/robot_description", String, LATCHED)
"""The URDF, as it stands in its file."""

CONSTRAINT = Topic("~/constraint", FixtureConstraint, NEWEST)
"""What the fixture allows; repeated as a heartbeat while nothing changes."""

DESIRED_TWIST = Topic("~/desired_twist", TwistStamped, NEWEST)
"""In: how the tool's tip shall move, m/s and rad/s, along the axes of the header's frame."""

ALLOWED_TWIST = Topic("~/allowed_twist", TwistStamped, NEWEST)
"""The answer to each desired twist: the nearest one that the constraint allows."""

GUIDANCE_WRENCH = Topic("~/guidance_wrench", WrenchStamped, NEWEST)
"""Where guidance is configured: the force at the tool's tip that warns the hand, N and N m."""

MARGIN_MM = Topic("~/margin_mm", Float64, STREAM)
"""Signed distance in mm, NaN while it is not known."""

MARGIN_COLOR = Topic("~/margin_color", ColorRGBA, LATCHED)
"""The colour of the margin state."""

MARKERS = Topic("~/markers", MarkerArray, LATCHED)
"""Tumour and tool as triangles, and the margin in words, from two publishers: see `Markers`."""

CLOCK = Topic("/clock", Clock, NEWEST)
"""The player's time, for nodes with ``use_sim_time``."""

DIAGNOSTICS = Topic("/diagnostics", DiagnosticArray, STREAM)
"""State, reasons, ages and lost poses, once a second of the player's time and at every change."""

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
"""The topics that every step is published on."""
