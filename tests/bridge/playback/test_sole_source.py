"""A playback is alone on its topics."""

import re
import threading

import pytest
from geometry_msgs.msg import TransformStamped
from sensor_msgs.msg import JointState
from tf2_msgs.msg import TFMessage

from app.bridge import topics
from app.bridge.node import RosNode
from app.bridge.playback import SoleSource
from app.bridge.publishing.session_publisher import SessionPublisher
from app.bridge.ros_errors import BridgeError
from app.bridge.topics import STREAM, Topic
from app.bridge.tracker_publisher import TRACKED_TRANSFORMS
from tests.waiting import DEADLINE_S

pytestmark = pytest.mark.long

ALONE = "expected no publisher besides the playback"


def error_of(child):
    """The line with which the process ends; its exit status is that of bad input."""
    assert child.wait() == 2
    (error,) = [line for line in child.log.read_text().splitlines() if "error" in line]
    return error


def test_playback_is_refused_beside_a_driver_and_ends_when_one_starts(tracker, playing, domain_id):
    running = playing()
    # The announcement or the poses of the first one are discovered first.
    error = error_of(tracker())
    assert "another playback runs on this graph: simulated lumpectomy 1" in error or (
        "/tf: another node publishes poses of" in error
    )
    with RosNode("driver", domain_id=domain_id) as driver:
        driver.publisher(TRACKED_TRANSFORMS)  # sends nothing
        error = error_of(running)
        assert f"/tracked_transforms: node /driver publishes on it too; {ALONE}" in error
        assert f"/tracked_transforms: node /driver publishes on it too; {ALONE}" in error_of(
            tracker()
        )


def test_driver_of_the_robot_ends_a_playback(playing, domain_id):
    running = playing()
    with RosNode("arm", domain_id=domain_id) as robot:
        robot.publisher(Topic("/joint_states", JointState, STREAM))
        assert "/joint_states: node /arm publishes on it too" in error_of(running)


def transform(child, sec):
    message = TransformStamped(child_frame_id=child)
    message.header.frame_id, message.header.stamp.sec = "tracker", sec
    return TFMessage(transforms=[message])


def test_tf_is_shared_except_for_the_poses_of_the_playback(playing, domain_id):
    running = playing()
    pause = threading.Event()
    with RosNode("other", domain_id=domain_id) as other:
        tf = other.publisher(topics.TF)
        assert other.wait_for_subscribers(topics.TF, 1, timeout_s=DEADLINE_S)
        for sec in range(20):
            tf.publish(transform("stylus", 1 + sec))
            pause.wait(0.02)
        other.flush()
        assert running.process.poll() is None
        tf.publish(transform("cautery", 100))
        error = error_of(running)
    assert f"/tf: another node publishes poses of 'cautery'; {ALONE}" in error


def test_playback_is_refused_beside_a_replay_that_sends_nothing(domain_id, content):
    text = "a case (simulated: a test)"
    with (
        SessionPublisher(content, domain_id=domain_id, playback=text),
        RosNode("marginguard_tracker", domain_id=domain_id) as ros,
    ):
        source = SoleSource(ros, [TRACKED_TRANSFORMS.name], {"cautery"})
        with pytest.raises(BridgeError, match=re.escape(f"runs on this graph: {text}")):
            source.wait_for_discovery(threading.Event())
