"""Senders of a session's inputs, followed with the publishers of a real graph."""

import threading
from types import SimpleNamespace

import numpy as np
import pytest
from geometry_msgs.msg import TransformStamped
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage

from app.bridge import topics
from app.bridge.live.inputs import PlaybackWatch
from app.bridge.live.sender_watch import SenderWatch
from app.bridge.message_origin import Origin, sender_of
from app.bridge.node import RosNode
from app.bridge.sender_names import SenderNames
from app.bridge.tf_topics import tf_message
from app.case.messages.message_values import JointValues, PoseValues
from app.fixture import Reason
from app.geometry import NS_PER_MS, Stamp, Transform
from app.session.frame_senders import MAX_FRAMES
from tests.bridge.nodes import ros_nodes
from tests.waiting import DEADLINE_S, wait_until

pytestmark = pytest.mark.slow

EDGES = [("tracker", "cautery"), ("tracker", "reference"), ("reference", "needle")]
BASE = Transform("reference", "robot_base", np.eye(3), [10.0, 0.0, 0.0])
A, B = Origin(b"a", 1), Origin(b"b", 1)


class Watched:
    """A `SenderWatch` of a node without session; notes that its edges are restored, or looks."""

    def __init__(self, ros):
        self.ros = ros
        self.restored = threading.Event()
        self.looked = threading.Semaphore(0)
        self.static_edges = (BASE,)
        constraint, static = ros.publisher(topics.CONSTRAINT), ros.publisher(topics.TF_STATIC)
        self.senders = SenderWatch(
            ros,
            "/tf",
            "/joint_states",
            frozenset({"waist"}),
            constraint=constraint,
            own=[constraint, static],
            restore_static=self.restored.set,
            find_players=self.looked.release,
        )
        static.publish(tf_message([(BASE, Stamp(0))]))
        self.senders.start(
            edges=lambda: EDGES,
            static_edges=lambda: self.static_edges,
            fresh_ns=lambda: 75 * NS_PER_MS,
            moving=True,
        )

    @property
    def problem(self):
        return self.senders.outside().get(Reason.SECOND_SENDER, "")

    def until(self, accept):
        """Wait until the text of the problem is accepted."""
        wait_until(lambda: accept(self.problem), describe=lambda: self.problem)
        return self.problem

    def pose(self, edge, origin, ns, x_m=0.0):
        values = PoseValues(*edge, ns, (x_m, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
        return self.senders.accepts_pose(values, origin)


@pytest.fixture
def watched(ros):
    watched = Watched(ros)
    yield watched
    ros.call(watched.senders.close)


@pytest.fixture
def rival(domain_id):
    with RosNode("rival", domain_id=domain_id) as node:
        yield node


@pytest.mark.parametrize("edge", [EDGES[0], ("odd", "cautery"), ("needle", "tracker")])
def test_second_sender_of_a_measured_frame_is_a_fault_and_is_not_used(watched, edge):
    for ns in range(5):
        assert all(watched.pose(each, A, ns) for each in EDGES)
    assert not watched.problem
    assert not watched.pose(edge, B, 5, x_m=0.1)
    for ns in (6, 7):
        assert all(watched.pose(each, A, ns) for each in EDGES)
    assert "on /tf" in watched.until(bool)
    assert watched.senders.counts() == {"samples of a second sender": 1}


def test_names_that_are_no_frames_do_not_hide_a_second_sender(watched):
    for number in range(2 * MAX_FRAMES):
        watched.pose(("tracker", f"no frame! {number}"), A, number)
    assert all(watched.pose(each, A, 10_000) for each in EDGES)
    assert not watched.pose(EDGES[0], B, 10_001, x_m=0.1)


def test_second_sender_of_another_frame_and_copies_are_no_fault(watched):
    for ns in range(20):
        assert all(watched.pose(each, A, ns) for each in EDGES)
        watched.pose(EDGES[0], B, ns)
        watched.pose(("base", "link"), A, ns)
        watched.pose(("base", "link"), B, ns, x_m=1.0)
    assert not watched.problem


@pytest.mark.parametrize("parent", ["tumor", "lump"])
def test_fixture_of_a_guard_in_another_namespace_is_counted_and_no_fault(
    watched, monkeypatch, parent
):
    logged, used = [], []
    logger = SimpleNamespace(warning=logged.append)
    monkeypatch.setattr(watched.ros.node, "get_logger", lambda: logger)
    for ns in range(20):
        assert all(watched.pose(each, A, ns) for each in EDGES)
        for edge, origin, x_m in (("tumor", A, 0.0), (parent, B, 1.0)):
            fixture = PoseValues(edge, "virtual_fixture", ns, (x_m, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
            watched.senders.take_tf([fixture], origin, latched=False)
            used.append(watched.senders.accepts_pose(fixture, origin))
    for _ in range(2):
        watched.ros.call(watched.senders._check)
    assert not watched.problem
    assert not any(used)
    assert list(watched.senders.counts()) == ["samples of virtual_fixture of another node"]
    (line,) = logged
    assert "-> virtual_fixture on /tf has several senders" in line


def test_second_sender_of_the_robots_joints_is_a_fault(watched):
    def joints(origin, ns, names=("waist", "elbow")):
        return watched.senders.accepts_joints(JointValues(names, (float(ns), 0.0), ns), origin)

    assert joints(A, 1)
    assert joints(B, 2, names=("finger", "thumb"))
    assert not joints(B, 3)
    assert joints(A, 4)
    assert "joints on /joint_states" in watched.until(bool)


def static(ros, parent, child, x_mm, angle_rad=0.0):
    """Publish a static transform by ``ros``."""
    edge = Transform.from_rotation_vector(
        [0.0, 0.0, angle_rad], [x_mm, 0.0, 0.0], target=parent, source=child
    )
    publisher = ros.publisher(topics.TF_STATIC)
    publisher.publish(tf_message([(edge, Stamp(0))]))
    return publisher


@pytest.mark.parametrize(
    ("parent", "child", "x_mm", "angle_rad"),
    [
        ("reference", "robot_base", 10.0, 3.14),
        ("reference", "robot_base", 10.1, 0.0),
        ("odd", "robot_base", 10.0, 0.0),
        ("odd", "cautery", 0.0, 0.0),
    ],
)
def test_static_transform_that_contradicts_the_session_is_a_fault_until_its_node_has_left(
    watched, rival, parent, child, x_mm, angle_rad
):
    static(rival, parent, child, x_mm, angle_rad)
    problem = watched.until(lambda text: "/rival" in text)
    assert f"{parent} -> {child} on /tf_static" in problem
    rival.close()
    watched.until(lambda text: not text)
    assert watched.restored.is_set() == (child == "robot_base")


def test_equal_static_transform_is_a_fault_as_soon_as_the_session_has_another_one(watched, rival):
    static(rival, "reference", "robot_base", 10.0)
    static(rival, "odd", "cautery", 0.0)
    assert "robot_base" not in watched.until(bool)  # the first one has arrived before
    watched.static_edges = (Transform("reference", "robot_base", np.eye(3), [11.0, 0.0, 0.0]),)
    watched.until(lambda text: "reference -> robot_base on /tf_static" in text)
    watched.static_edges = (BASE,)
    watched.until(lambda text: text and "robot_base" not in text)
    rival.close()
    watched.until(lambda text: not text)
    assert not watched.restored.is_set()


def test_static_transforms_of_other_frames_and_equal_ones_are_no_fault(watched, rival):
    static(rival, "reference", "robot_base", 10.001)
    static(rival, "map", "tracker", 5.0)
    static(rival, "odd", "marker", 0.0)
    # Its own message and those three have arrived when a fourth one, a fault, has.
    static(rival, "odd", "cautery", 0.0)
    problem = watched.until(bool)
    assert "cautery" in problem and "robot_base" not in problem and "tracker" not in problem


def test_own_static_frame_on_tf_is_a_fault(watched, rival):
    publisher = rival.publisher(topics.TF)
    message = TFMessage(transforms=[TransformStamped()])
    message.transforms[0].header.frame_id = "reference"
    message.transforms[0].child_frame_id = "robot_base"
    message.transforms[0].transform.rotation.w = 1.0
    wait_until(lambda: watched.problem, lambda: publisher.publish(message))
    assert "reference -> robot_base on /tf" in watched.problem


def test_answer_after_outdate_is_that_of_the_present_graph(ros, domain_id):
    names = SenderNames(ros, "/tf")
    names.refresh()

    def is_present():
        names.outdate()
        return names.is_present(sender)

    with RosNode("rival", domain_id=domain_id) as rival:
        sender = sender_of(rival.publisher(topics.TF))
        wait_until(is_present)
        wait_until(lambda: names.text([sender]) == "node /rival", names.outdate)
        names.outdate()
    wait_until(lambda: not is_present())
    assert names.text([sender]) == "node /rival"


def test_any_other_publisher_of_the_constraint_is_a_fault_until_it_has_left(watched, domain_id):
    assert not watched.problem
    with RosNode("marginguard", namespace="", domain_id=domain_id) as other:
        other.publisher(topics.CONSTRAINT)
        assert "/marginguard/constraint" in watched.until(bool)
    watched.until(lambda text: not text)


@pytest.mark.parametrize(
    ("name", "services", "is_player"),
    [
        ("rosbag2_player", (), True),
        ("renamed", ("get_rate", "burst", "seek"), True),
        ("robot", ("get_rate",), False),
    ],
)
def test_bag_player_that_publishes_an_input_is_a_playback(domain_id, name, services, is_player):
    with ros_nodes(domain_id, "marginguard", name) as (ros, player):
        watch = PlaybackWatch(ros, ["/joint_states"])
        for service in services:
            player.node.create_service(Trigger, f"~/{service}", lambda _, response: response)
        player.publisher(topics.JOINT_STATES)
        other = player.publisher(topics.PLAYBACK) if not is_player else None
        found = wait_until(watch.found, lambda: ros.call(watch.check))
        if is_player:
            assert found == f"poses from a recording, played by the node /{name}"
        else:  # only the announcement is found
            other.publish(String(data="case 1"))
            wait_until(lambda: "case 1" in watch.found())
            assert "played by" not in watch.found()


def test_bag_players_are_looked_for_repeatedly_although_the_other_check_fails(watched):
    for _ in range(3):
        assert watched.looked.acquire(timeout=DEADLINE_S)
    watched.static_edges = None
    wait_until(lambda: watched.ros.failures > 1)
    while watched.looked.acquire(blocking=False):
        pass
    for _ in range(3):
        assert watched.looked.acquire(timeout=DEADLINE_S)


def test_bag_player_of_another_topic_is_no_playback(domain_id):
    with ros_nodes(domain_id, "marginguard", "rosbag2_player") as (ros, player):
        watch = PlaybackWatch(ros, ["/joint_states"])
        received = threading.Event()
        topic = topics.Topic("/other_joints", JointState, topics.STREAM)
        ros.subscribe(topic, lambda _: received.set())
        publisher = player.publisher(topic)
        assert player.wait_for_subscribers(topic, 1, DEADLINE_S)
        publisher.publish(JointState())
        assert received.wait(DEADLINE_S)
        ros.call(watch.check)
        assert watch.found() == ""
