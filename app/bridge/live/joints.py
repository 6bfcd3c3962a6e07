"""Joint states for a live session."""

from collections.abc import Callable, Sequence

from sensor_msgs.msg import JointState

from app.bridge.live.subscription import CountedSubscription
from app.bridge.message_origin import Origin
from app.bridge.node import RosNode
from app.bridge.qos import INCOMING, Topic
from app.case import JointSample
from app.case.messages.ros_messages import JOINT_STATE
from app.case.messages.values import JointValues
from app.robot import JointError


def listen_to_joints(
    ros: RosNode,
    topic: str,
    offset_ns: int,
    deliver: Callable[[JointSample], None],
    accepts: Callable[[JointValues, Origin], bool],
    is_complete: Callable[[Sequence[str]], bool],
) -> CountedSubscription:
    """Deliver each joint state of ``topic`` with ``offset_ns`` added to the robot's stamps.

    Those that ``accepts`` refuses are not delivered. Neither are those that are not
    ``is_complete`` by the names of their joints: they are of another device, or a part of the arm.
    They are counted as `JointError`.
    """

    def receive(values: JointValues, origin: Origin) -> None:
        if not accepts(values, origin):
            return
        if not is_complete(values.names):
            raise JointError(f"{topic}: a message without all joints that move the tool")
        deliver(values.sample(offset_ns=offset_ns))

    return CountedSubscription(ros, Topic(topic, JointState, INCOMING), JOINT_STATE, receive)
