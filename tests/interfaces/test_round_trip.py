"""Messages, a service and an action exchanged with another process."""

import queue
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tests.bridge.conftest import Child

rclpy = pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from action_msgs.msg import GoalStatus  # noqa: E402
from builtin_interfaces.msg import Time  # noqa: E402
from geometry_msgs.msg import Point, TransformStamped, Vector3  # noqa: E402
from marginguard_msgs.action import Replay  # noqa: E402
from marginguard_msgs.msg import FixtureConstraint, HalfSpace, TrackedTransform  # noqa: E402
from marginguard_msgs.srv import Register  # noqa: E402
from rclpy.action import ActionClient  # noqa: E402
from rclpy.serialization import deserialize_message, serialize_message  # noqa: E402
from rclpy.task import Future  # noqa: E402
from tf2_msgs.msg import TFMessage  # noqa: E402

DEADLINE_S = 30.0


def wait(future: Future) -> Any:
    """Wait for the result of ``future``, which the thread of the node completes."""
    return wait_up_to(DEADLINE_S, future)


def wait_up_to(seconds: float, future: Future) -> Any:
    done: queue.Queue[Future] = queue.Queue()
    future.add_done_callback(done.put)
    return done.get(timeout=seconds).result()


def reply_to(send: Callable[[], Future]) -> Any:
    """Wait for the reply to the request that ``send`` sends.

    Repeats the request, because a server drops the reply to a client that it has not discovered yet
    and the client cannot detect when it has.
    """
    for _ in range(3):
        try:
            return wait_up_to(DEADLINE_S / 3, send())
        except queue.Empty:
            continue
    pytest.fail(f"no reply in {DEADLINE_S} s")


def transforms() -> TFMessage:
    edge = TransformStamped(child_frame_id="virtual_fixture")
    edge.header.frame_id = "tumor"
    edge.header.stamp = Time(sec=12, nanosec=345_678_901)
    edge.transform.translation = Vector3(x=0.0125, y=-1e-9, z=3.5)
    return TFMessage(transforms=[edge, TransformStamped(child_frame_id="needle")])


def constraint() -> FixtureConstraint:
    planes = [
        HalfSpace(
            normal=Vector3(x=0.6, y=0.0, z=0.8),
            offset=-0.004 * index,
            point_on_tool=Point(x=0.1, y=0.2, z=0.3 + index),
            tumor_velocity=Vector3(z=0.002),
        )
        for index in range(8)
    ]
    message = FixtureConstraint(
        seq=2**63 + 7,
        valid_until=Time(sec=12, nanosec=999_999_999),
        state=FixtureConstraint.UNKNOWN,
        reasons=["stale", "missing"],
        hold=True,
        half_spaces=planes,
        signed_distance=-0.0042,
        lower_bound=-0.0045,
        stop_distance=0.001,
        warn_distance=float("inf"),
        sigma_tre=0.0003,
        model_id="sha256:00",
        registration_id="é",  # a name may hold any character
    )
    message.header.frame_id = "tumor"
    return message


@pytest.mark.parametrize(("name", "message"), [("tf", transforms()), ("constraint", constraint())])
def test_returned_message_equals_the_sent_one(
    node: Any, peer: Child, name: str, message: Any
) -> None:
    returned: queue.Queue[Any] = queue.Queue()
    node.create_subscription(type(message), f"{name}_back", returned.put, 10)
    publisher = node.create_publisher(type(message), f"{name}_out", 10)
    for _ in range(300):  # a message sent before discovery is complete is lost
        publisher.publish(message)
        try:
            back = returned.get(timeout=0.1)
        except queue.Empty:
            continue
        assert back == message
        return
    pytest.fail(f"no message on {name}_back")


def test_service_replies(node: Any, peer: Child) -> None:
    client = node.create_client(Register, "register")
    assert client.wait_for_service(timeout_sec=DEADLINE_S)
    request = Register.Request(
        fixed_frame="reference",
        moving_frame="robot_base",
        fixed_points=[Point(), Point()],
        moving_points=[Point(x=0.25), Point(x=0.5)],
    )
    response = reply_to(lambda: client.call_async(request))
    assert response.success
    assert response.message == "reference from robot_base"
    assert response.transform.translation.x == 0.75


def test_action_publishes_feedback_and_is_cancelled(node: Any, peer: Child) -> None:
    client = ActionClient(node, Replay, "replay")
    assert client.wait_for_server(timeout_sec=DEADLINE_S)
    goal = Replay.Goal(case_folder="a case", rate=1.0, start=2.0, end=DEADLINE_S)
    feedback: list[queue.Queue[Any]] = []

    def send() -> Future:
        feedback.append(queue.Queue())
        return client.send_goal_async(goal, feedback_callback=feedback[-1].put)

    handle = reply_to(send)
    assert handle.accepted
    received = [feedback[-1].get(timeout=DEADLINE_S).feedback for _ in range(3)]
    assert wait(handle.cancel_goal_async()).goals_canceling
    reply = wait(handle.get_result_async())
    assert reply.status == GoalStatus.STATUS_CANCELED
    assert reply.result.message == "a case"
    assert reply.result.frames >= 3
    frames = [each.frames for each in received]
    assert frames == list(range(frames[0], frames[0] + 3))
    assert all(each.time == 2.0 and np.isnan(each.signed_distance) for each in received)
    client.destroy()


def test_serialised_lost_pose_keeps_its_nan() -> None:
    lost = TrackedTransform(child_frame_id="cautery", status=TrackedTransform.OUT_OF_VIEW)
    lost.transform.rotation.w = float("nan")
    back = deserialize_message(serialize_message(lost), TrackedTransform)
    assert back.status == TrackedTransform.OUT_OF_VIEW
    assert np.isnan(back.transform.rotation.w)
