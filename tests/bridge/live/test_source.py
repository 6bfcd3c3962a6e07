"""Live sources: invalid messages are counted, valid ones are delivered."""

import json
import threading
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from geometry_msgs.msg import TransformStamped
from marginguard_msgs.msg import TrackedTransform
from sensor_msgs.msg import JointState
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

from app.bridge import topics
from app.bridge.live.sources import TfSource, TrackedTransformSource, listen_to_joints
from app.bridge.tf import TransformBuffer
from app.bridge.tf_topics import TfListener
from app.bridge.topics import STREAM, Topic
from app.geometry import TrackingStatus
from tests.bridge.conftest import CYCLONE_ON_THIS_MACHINE
from tests.waiting import DEADLINE_S, wait_until

pytestmark = pytest.mark.slow

TRACKED = Topic("/tracked_transforms", TrackedTransform, STREAM)
HELLO = "hello"
LOOKUPS = 30
SENDER = Path(__file__).with_name("sender.py")
CYCLONE_TRACKER = Path(__file__).resolve().parents[1] / "cyclone_tracker.py"


class EverySender:
    """Test double of a `SenderWatch` that accepts the samples of every sender."""

    def accepts_pose(self, pose, origin):
        return True

    def accepts_joints(self, joints, origin):
        return True

    def take_tf(self, poses, origin, *, latched):
        pass


EVERY_SENDER = EverySender()


class Inbox:
    """Collects delivered samples. ``HELLO`` samples only establish the connection."""

    def __init__(self):
        self.changed = threading.Condition()
        self.samples = []

    def take(self, samples):
        with self.changed:
            self.samples += samples
            self.changed.notify_all()

    def wait_until(self, accept):
        """Wait until ``accept`` accepts the list of samples without ``HELLO``; return the list."""
        with self.changed:
            assert self.changed.wait_for(lambda: accept(self._without_hello()), DEADLINE_S)
            return self._without_hello()

    def _without_hello(self):
        return [sample for sample in self.samples if getattr(sample, "source", "") != HELLO]


def edge(child, x=0.1, parent="tracker", w=1.0, kind=TransformStamped, **values):
    message = kind(header=Header(frame_id=parent), child_frame_id=child, **values)
    message.header.stamp.sec = 7
    message.transform.translation.x = x
    message.transform.rotation.w = w
    return message


def publish_until_received(publisher, message, inbox):
    """Repeat ``message``: best effort drops what is sent before the reader has discovered us."""
    with inbox.changed:
        while not inbox.samples:
            publisher.publish(message)
            inbox.changed.wait(0.1)


def has_ended(samples):
    return any(sample.source == "end" for sample in samples)


def test_invalid_transforms_do_not_affect_valid_ones_of_a_message(ros, other):
    inbox = Inbox()
    source = TfSource(ros, inbox.take, EVERY_SENDER)
    publisher = other.publisher(topics.TF)
    publish_until_received(publisher, TFMessage(transforms=[edge(HELLO)]), inbox)
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
    found = {sample.source: sample for sample in inbox.wait_until(has_ended)}
    assert found["cautery"].transform.translation_mm == pytest.approx([100.0, 0.0, 0.0])
    assert found["needle"].transform.translation_mm == pytest.approx([-200.0, 0.0, 0.0])
    assert found["needle"].stamp.ns == 7_000_000_000
    assert found["nan"].status is TrackingStatus.NOT_FINITE
    assert found["none"].status is TrackingStatus.NOT_RIGID
    assert "end" in found
    assert len(found) == 6  # includes the loop, which the session cannot use
    counts = source.counts()
    hellos = sum(sample.source == HELLO for sample in inbox.samples)
    assert counts["/tf: messages"] == hellos + 3
    assert counts["/tf: refused (longer than 1048576 bytes)"] == 1
    assert sum(n for name, n in counts.items() if "refused" in name) >= 2
    assert ros.failures == 0


def test_lost_pose_has_its_status_and_closed_source_delivers_nothing(ros, other):
    inbox = Inbox()
    source = TrackedTransformSource(ros, TRACKED.name, inbox.take, EVERY_SENDER)
    publisher = other.publisher(TRACKED)
    publish_until_received(publisher, edge(HELLO, kind=TrackedTransform), inbox)
    publisher.publish(edge("cautery", kind=TrackedTransform, status=3))
    publisher.publish(edge("cautery", kind=TrackedTransform, status=250))
    publisher.publish(edge("cautery", kind=TrackedTransform, status=0))
    statuses = [sample.status for sample in inbox.wait_until(lambda samples: len(samples) == 3)]
    assert statuses == [TrackingStatus.OUT_OF_VIEW, TrackingStatus.INVALID, TrackingStatus.OK]
    source.close()
    source.close()


def test_non_finite_joints_and_those_of_other_devices_are_skipped(ros, other):
    inbox = Inbox()
    joints = listen_to_joints(
        ros,
        "/joint_states",
        5,
        lambda sample: inbox.take([sample]),
        EVERY_SENDER.accepts_joints,
        lambda names: "a" in names,
    )
    publisher = other.publisher(topics.JOINT_STATES)
    publish_until_received(publisher, JointState(name=["a"], position=[0.25]), inbox)
    publisher.publish(JointState(name=["gripper"], position=[9.0]))
    publisher.publish(JointState(name=["a", "b"], position=[1.0]))
    publisher.publish(JointState(name=["a"], position=[float("inf")]))
    publisher.publish(JointState(name=["a"], position=[0.5]))
    samples = inbox.wait_until(lambda samples: samples[-1].as_mapping() == {"a": 0.5})
    assert all(sample.as_mapping() == {"a": 0.25} for sample in samples[:-1])
    assert samples[-1].stamp.ns == 5
    assert joints.counts()["/joint_states: refused (InputError)"] == 2
    assert joints.counts()["/joint_states: refused (JointError)"] == 1
    assert ros.failures == 0


@pytest.mark.parametrize("kind", ["tf", "tracked"])
def test_best_effort_drivers_are_received(start_sender, ros, frames_file, kind):
    """Messages of another process with the QoS of sensor data arrive."""
    poses, joints = Inbox(), Inbox()
    if kind == "tf":
        TfSource(ros, poses.take, EVERY_SENDER)
    else:
        TrackedTransformSource(ros, TRACKED.name, poses.take, EVERY_SENDER)
    listen_to_joints(
        ros,
        "/joint_states",
        0,
        lambda sample: joints.take([sample]),
        EVERY_SENDER.accepts_joints,
        lambda names: True,
    )
    sender = start_sender(kind, "again", "best_effort")
    sender.line(lambda line: line.startswith("shift"))
    sample = poses.wait_until(bool)[0]
    sent_m = [
        sent["translation_m"]
        for frame in json.loads(frames_file.read_text())
        for sent in frame["edges"]
        if sent["child"] == sample.source
    ]
    off_m = np.abs(np.array(sent_m) - sample.transform.translation_mm / 1000.0)
    assert off_m.max(axis=1).min() < 1e-9
    assert joints.wait_until(bool)
    assert ros.incompatible == {}


def test_lost_sample_delays_a_lookup_and_not_a_session(ros, start, monkeypatch):
    """Cyclone DDS drops 40 % of the packets of a reliable writer.

    The listener for lookups receives every edge, because the next one is sent only after the lookup
    of the one before. The best-effort source of the session receives some of them, in order.
    """
    uri = CYCLONE_ON_THIS_MACHINE["CYCLONEDDS_URI"]
    lossy = "<Internal><Test><XmitLossiness>400</XmitLossiness></Test></Internal></Domain>"
    monkeypatch.setenv("CYCLONEDDS_URI", uri.replace("</Domain>", lossy))
    inbox, buffer = Inbox(), TransformBuffer()
    TfSource(ros, inbox.take, EVERY_SENDER)
    TfListener(ros, buffer)
    tracker = start(CYCLONE_TRACKER)
    assert tracker.line() == "ready"
    for number in range(LOOKUPS):
        tracker.send("next")
        wait_until(lambda sent=f"sent_{number}": buffer.parent(sent))
        assert buffer.lookup("tracker", f"sent_{number}").stamp_ns == number
    received_ns = [sample.stamp.ns for sample in inbox.samples]
    assert 0 < len(received_ns) < LOOKUPS
    assert all(earlier < later for earlier, later in pairwise(received_ns))
