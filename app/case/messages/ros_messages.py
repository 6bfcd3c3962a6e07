"""Types and topics of recorded ROS messages, by rosbags without ROS."""

from functools import cache
from typing import Any

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from app.case.messages.cdr_template import stamp_parts
from app.geometry import Stamp

TRACKED_TRANSFORMS_TOPIC = "/tracked_transforms"
TF_TOPIC = "/tf"
JOINT_STATES_TOPIC = "/joint_states"
UNFILTERED_TIME_TOPIC = "/tracked_transforms/unfiltered_time"
"""Second clock of an IGSIO recording: header.stamp is the frame's stamp, time_ref the other."""

TRACKED_TRANSFORM = "marginguard_msgs/msg/TrackedTransform"
TF_MESSAGE = "tf2_msgs/msg/TFMessage"
JOINT_STATE = "sensor_msgs/msg/JointState"
TIME_REFERENCE = "sensor_msgs/msg/TimeReference"
BOOL = "std_msgs/msg/Bool"
RANGE = "sensor_msgs/msg/Range"

TRACKED_TRANSFORM_DEFINITION = """\
uint8 OK=0
uint8 INVALID=1
uint8 MISSING=2
uint8 OUT_OF_VIEW=3
uint8 OUT_OF_VOLUME=4
uint8 REQUEST_TIMEOUT=5
uint8 NOT_FINITE=6
uint8 NOT_RIGID=7
std_msgs/Header header
string child_frame_id
geometry_msgs/Transform transform
uint8 status
"""


@cache
def ros_types() -> Typestore:
    """The message types of ROS 2 Jazzy and of this project; shared and never modified."""
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(TRACKED_TRANSFORM_DEFINITION, TRACKED_TRANSFORM))
    return store


def time_reference_message(stamp: Stamp, unfiltered: Stamp) -> Any:
    """Build a ``sensor_msgs/TimeReference``: the time of the unsmoothed clock at ``stamp``."""
    return ros_types().types[TIME_REFERENCE](
        header=_header(stamp.ns, ""), time_ref=_time(unfiltered.ns), source="unfiltered"
    )


def _header(ns: int, frame: str) -> Any:
    return ros_types().types["std_msgs/msg/Header"](stamp=_time(ns), frame_id=frame)


def _time(ns: int) -> Any:
    sec, nanosec = stamp_parts(ns)
    return ros_types().types["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec)
