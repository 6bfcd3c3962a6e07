"""Live sources against strangers: hostile messages are counted, good ones are delivered."""

import threading

import pytest
from geometry_msgs.msg import TransformStamped
from marginguard_msgs.msg import TrackedTransform
from sensor_msgs.msg import JointState
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

from app.bridge import topics
from app.bridge.live import TfSource, TrackedTransformSource, listen_to_joints
from app.bridge.node import RosNode
from app.bridge.qos import STREAM, Topic
from app.geometry import TrackingStatus

TRACKED = Topic("/tracked_transforms", TrackedTransform, STREAM)
WAIT_S = 30.0


class Inbox:
    def __init__(self):
        self.changed = threading.Condition()
        self.samples = []

    def take(self, samples):
        with self.changed:
            self.samples += samples
            self.changed.notify_all()

    def wait_for(self, count):
        with self.changed:
            assert self.changed.wait_for(lambda: len(self.samples) >= count, WAIT_S)
            return list(self.samples)


@pytest.fixture
def nodes(domain_id):
    with (
        RosNode("guard", domain_id=domain_id) as guard,
        RosNode("tracker", domain_id=domain_id) as tracker,
    ):
        yield guard, tracker


def edge(child, x=0.1, parent="tracker", w=1.0, kind=TransformStamped, **values):
    message = kind(header=Header(frame_id=parent), child_frame_id=child, **values)
    message.header.stamp.sec = 7
    message.transform.translation.x = x
    message.transform.rotation.w = w
    return message


def test_bad_transforms_of_a_tf_message_do_not_take_the_good_ones_with_them(nodes):
    guard, tracker = nodes
    inbox = Inbox()
    source = TfSource(guard, inbox.take)
    publisher = tracker.publisher(topics.TF)
    assert tracker.wait_for_subscribers(topics.TF, 1, WAIT_S)
    publisher.publish(
        TFMessage(
            transforms=[
                edge("cautery"),
                edge(""),
                edge("loop", parent="loop"),
                edge("nan", x=float("nan")),
                edge("none", w=0.0),
                edge("needle", x=-0.2),
            ]
        )
    )
    publisher.publish(TFMessage(transforms=[edge("y" * 2_000_000)]))
    publisher.publish(TFMessage(transforms=[edge("end")]))
    found = {sample.source: sample for sample in inbox.wait_for(6)}
    assert found["cautery"].transform.translation_mm == pytest.approx([100.0, 0.0, 0.0])
    assert found["needle"].transform.translation_mm == pytest.approx([-200.0, 0.0, 0.0])
    assert found["needle"].stamp.ns == 7_000_000_000
    assert found["nan"].status is TrackingStatus.NOT_FINITE
    assert found["none"].status is TrackingStatus.NOT_RIGID
    assert "end" in found
    assert len(found) == 6  # the loop too: a session finds no way through it
    counts = source.counts()
    assert counts["/tf: messages"] == 3
    assert counts["/tf: refused (longer than 1048576 bytes)"] == 1
    assert sum(n for name, n in counts.items() if "refused" in name) >= 2
    assert guard.failures == 0


def test_a_lost_pose_comes_with_its_status_and_a_closed_source_is_silent(nodes):
    guard, tracker = nodes
    inbox = Inbox()
    source = TrackedTransformSource(guard, TRACKED.name, inbox.take)
    publisher = tracker.publisher(TRACKED)
    assert tracker.wait_for_subscribers(TRACKED, 1, WAIT_S)
    publisher.publish(edge("cautery", kind=TrackedTransform, status=3))
    publisher.publish(edge("cautery", kind=TrackedTransform, status=250))
    publisher.publish(edge("cautery", kind=TrackedTransform, status=0))
    statuses = [sample.status for sample in inbox.wait_for(3)]
    assert statuses == [TrackingStatus.OUT_OF_VIEW, TrackingStatus.INVALID, TrackingStatus.OK]
    source.close()
    source.close()


def test_joints_that_are_not_numbers_are_left_out(nodes):
    guard, tracker = nodes
    inbox = Inbox()
    joints = listen_to_joints(guard, "/joint_states", 5, lambda sample: inbox.take([sample]))
    publisher = tracker.publisher(topics.JOINT_STATES)
    assert tracker.wait_for_subscribers(topics.JOINT_STATES, 1, WAIT_S)
    publisher.publish(JointState(name=["a", "b"], position=[1.0]))
    publisher.publish(JointState(name=["a"], position=[float("inf")]))
    publisher.publish(JointState(name=["a"], position=[0.5]))
    (sample,) = inbox.wait_for(1)
    assert sample.as_mapping() == {"a": 0.5}
    assert sample.stamp.ns == 5
    assert joints.counts()["/joint_states: refused (InputError)"] == 2
    assert guard.failures == 0
