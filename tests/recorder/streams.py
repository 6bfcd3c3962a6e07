"""The topics that `tests.recorder.sender` sends, with the rates of a real session."""

from dataclasses import dataclass

from geometry_msgs.msg import TransformStamped
from marginguard_msgs.msg import FixtureConstraint, TrackedTransform
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from tf2_msgs.msg import TFMessage

from app.bridge.topics import STREAM, Topic

TICK_HZ = 1000
_TOOLS = ("reference", "needle", "cautery")


@dataclass(frozen=True, slots=True)
class Stream:
    """Messages on ``topic``: one of each of ``messages`` (CDR) every ``ticks`` ticks.

    ``stamp_at`` is the offset of the stamp in the CDR bytes.
    """

    topic: Topic
    ticks: int
    messages: tuple[bytes, ...]
    stamp_at: int = 4


def streams() -> tuple[Stream, ...]:
    """Three tools and tf at 200 Hz, joints at 500 Hz, the constraint at 1 kHz."""
    return (
        _stream("/tracked_transforms", TrackedTransform, 5, *map(_tracked, _TOOLS)),
        _stream("/tf", TFMessage, 5, TFMessage(transforms=list(map(_stamped, _TOOLS))), stamp_at=8),
        _stream("/joint_states", JointState, 2, _joints()),
        _stream("/marginguard/constraint", FixtureConstraint, 1, _constraint()),
    )


def _stream(
    name: str, message_type: type, ticks: int, *messages: object, stamp_at: int = 4
) -> Stream:
    raw = tuple(serialize_message(message) for message in messages)
    return Stream(Topic(name, message_type, STREAM), ticks, raw, stamp_at)


def _tracked(tool: str) -> TrackedTransform:
    stamped = _stamped(tool)
    return TrackedTransform(
        header=stamped.header, child_frame_id=tool, transform=stamped.transform, status=0
    )


def _stamped(tool: str) -> TransformStamped:
    message = TransformStamped(child_frame_id=tool)
    message.header.frame_id = "tracker"
    return message


def _joints() -> JointState:
    names = ["waist", "shoulder", "elbow", "yaw", "pitch", "roll"]
    return JointState(name=names, position=[0.1] * 6, velocity=[0.0] * 6, effort=[0.0] * 6)


def _constraint() -> FixtureConstraint:
    return FixtureConstraint(instance_id="0123456789abcdef", reasons=["too_close"])
