"""Topics of a replay received by another process: SI units and source stamps."""

import math
from dataclasses import replace

import numpy as np
import pytest
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

from app.bridge import topics
from app.bridge.publishing.serialized import PublishPolicy
from app.bridge.publishing.session_publisher import SessionPublisher
from app.bridge.ros_errors import BridgeError
from app.fixture import MarginState
from app.geometry import SurfaceMesh, Transform
from app.registration import given_registration
from app.runtime import StepTiming, StructureContent
from app.session import Role
from tests.session_content import registered
from tests.waiting import DEADLINE_S

pytestmark = pytest.mark.slow

TF = "/tf:tf2_msgs/msg/TFMessage"
TF_STATIC = "/tf_static:tf2_msgs/msg/TFMessage"
JOINTS = "/joint_states:sensor_msgs/msg/JointState"
DESCRIPTION = "/robot_description:std_msgs/msg/String"
CONSTRAINT = "/marginguard/constraint:marginguard_msgs/msg/FixtureConstraint"
MARGIN_MM = "/marginguard/margin_mm:std_msgs/msg/Float64"
COLOR = "/marginguard/margin_color:std_msgs/msg/ColorRGBA"
MARKERS = "/marginguard/markers:visualization_msgs/msg/MarkerArray"
CLOCK = "/clock:rosgraph_msgs/msg/Clock"
DIAGNOSTICS = "/diagnostics:diagnostic_msgs/msg/DiagnosticArray"
EVERYTHING = [
    f"{TF}:5",
    f"{TF_STATIC}:1:latched",
    f"{JOINTS}:5",
    f"{DESCRIPTION}:1:latched",
    f"{CONSTRAINT}:5",
    f"{MARGIN_MM}:5",
    f"{COLOR}:5:latched",
    f"{MARKERS}:9:latched",
    f"{CLOCK}:5",
    f"{DIAGNOSTICS}:3",
]


def ns(time):
    return time["sec"] * 10**9 + time["nanosec"]


def wait_for_one_subscriber(ros, *subscribed):
    for topic in subscribed:
        assert ros.ros.wait_for_subscribers(topic, 1, timeout_s=DEADLINE_S)


MESSAGES_AT_START = 3  # static frames, description, surfaces
MESSAGES_PER_STEP = 7  # clock, tf, joints, constraint, distance, colour, text
MESSAGES_PER_CHANGE = 2  # surfaces, diagnostics


@pytest.fixture
def received(domain_id, content, make_step, start_receiver):
    """Messages by topic of five steps; the tool is lost in the third."""
    with SessionPublisher(content, domain_id=domain_id) as ros:
        receiver = start_receiver(*EVERYTHING)
        wait_for_one_subscriber(ros, *topics.EVERY_STEP)
        lines = receiver.take(MESSAGES_AT_START)
        for index in range(5):
            ros.publish(make_step(index, lost=index == 2), StepTiming())
            # Take all messages of a step before the next one: a topic of depth 1 may drop messages
            # that a faster publisher overwrites.
            changed = index in {0, 2, 3}
            lines += receiver.take(MESSAGES_PER_STEP + (MESSAGES_PER_CHANGE if changed else 0))
        assert receiver.messages() == []
    by_topic = {}
    for line in lines:
        by_topic.setdefault(line["topic"], []).append(line["message"])
    return by_topic


def test_every_topic_carries_its_values(received, content, make_step):
    now_ns = [make_step(index).frame.stamp.ns for index in range(5)]
    check_tf(received["/tf"], now_ns)
    check_static(received["/tf_static"])
    check_joints(received["/joint_states"], now_ns)
    check_constraints(received["/marginguard/constraint"], now_ns)
    assert received["/robot_description"] == [{"data": content.robot_description()}]
    distances = [message["data"] for message in received["/marginguard/margin_mm"]]
    assert distances == pytest.approx([7.5, 7.5, float("nan"), 7.5, 7.5], nan_ok=True)
    colors = [
        (color["r"], color["g"], color["b"]) for color in received["/marginguard/margin_color"]
    ]
    clear, unknown = MarginState.NEGATIVE.color, MarginState.UNKNOWN.color
    for color, expected in zip(colors, [clear, clear, unknown, clear, clear], strict=True):
        assert color == pytest.approx(expected, abs=1e-7)  # the message has 32 bits
    assert [ns(message["clock"]) for message in received["/clock"]] == now_ns
    levels = [message["status"][0]["level"] for message in received["/diagnostics"]]
    assert levels == [0, 3, 0]
    check_markers(received["/marginguard/markers"])


def check_tf(messages, now_ns):
    assert len(messages) == 5
    for index, message in enumerate(messages):
        edges = {
            (edge["header"]["frame_id"], edge["child_frame_id"]): edge
            for edge in message["transforms"]
        }
        always = {("reference", "needle"), ("base_link", "stylus")}
        tracked = {("tracker", "cautery"), ("tumor", "virtual_fixture")}
        assert set(edges) == (always if index == 2 else always | tracked)
        assert ns(edges["base_link", "stylus"]["header"]["stamp"]) == now_ns[index] - 5_000_000
        stylus = edges["base_link", "stylus"]["transform"]["translation"]
        assert stylus == {"x": 0.0, "y": 0.0, "z": 0.13335}
        if index == 2:
            continue
        cautery = edges["tracker", "cautery"]
        assert ns(cautery["header"]["stamp"]) == now_ns[index]
        assert cautery["transform"]["translation"] == pytest.approx(
            {"x": 0.1 + 0.001 * index, "y": -0.02, "z": 0.03}
        )
        fixture = edges["tumor", "virtual_fixture"]
        assert ns(fixture["header"]["stamp"]) == now_ns[index] - 3_000_000
        # The plane z = 12.5 mm, under the tool's point (1, 2, 17.5).
        assert fixture["transform"]["translation"] == pytest.approx(
            {"x": 0.001, "y": 0.002, "z": 0.0125}
        )


def check_static(messages):
    (message,) = messages
    edges = {
        (edge["header"]["frame_id"], edge["child_frame_id"]): edge["transform"]["translation"]
        for edge in message["transforms"]
    }
    assert edges == {
        ("cautery", "cautery_tip"): {"x": 0.0, "y": 0.0, "z": 0.12},
        ("needle", "tumor"): {"x": 0.001, "y": 0.002, "z": 0.003},
        ("reference", "robot_base"): {"x": 0.5, "y": 0.0, "z": -0.25},
        ("robot_base", "base_link"): {"x": 0.0, "y": 0.0, "z": 0.0},
    }


def check_joints(messages, now_ns):
    assert [ns(message["header"]["stamp"]) for message in messages] == [
        stamp - 5_000_000 for stamp in now_ns
    ]
    assert {tuple(message["position"]) for message in messages} == {(0.5, 0.01)}
    assert {tuple(message["name"]) for message in messages} == {("waist", "slide")}


def check_constraints(messages, now_ns):
    assert [message["seq"] for message in messages] == [0, 1, 2, 3, 4]
    for message in messages:
        # A lost step keeps the stamp of the planes of the step before.
        index = 1 if message["seq"] == 2 else message["seq"]
        assert ns(message["header"]["stamp"]) == now_ns[index] - 3_000_000
        assert ns(message["valid_until"]) == now_ns[index] + 197_000_000
        assert message["hold"] == (message["seq"] == 2)
        assert message["half_spaces"][0]["offset"] == 0.0125


def check_markers(messages):
    named = [{marker["ns"]: marker for marker in message["markers"]} for message in messages]
    texts = [markers["margin"]["text"] for markers in named if "margin" in markers]
    assert texts == ["CLEAR +7.5 mm"] * 2 + ["UNKNOWN: invalid, latched"] + ["CLEAR +7.5 mm"] * 2
    surfaces = [markers for markers in named if "tumor" in markers]
    assert [surface["tumor"]["color"]["g"] for surface in surfaces] == [0.5, 1.0, 0.5, 1.0]
    for surface in surfaces:
        assert len(surface["tumor"]["points"]) == len(surface["tool"]["points"]) == 12


def test_late_subscriber_gets_all_latched_messages(domain_id, content, make_step, start_receiver):
    with SessionPublisher(content, domain_id=domain_id) as ros:
        for index in range(3):
            ros.publish(make_step(index, state=MarginState.WARNING), StepTiming())
        received = start_receiver(
            f"{TF_STATIC}:1:latched",
            f"{DESCRIPTION}:1:latched",
            f"{MARKERS}:2:latched",
            f"{COLOR}:1:latched",
        ).messages()
    markers = [
        marker
        for line in received
        if line["topic"] == "/marginguard/markers"
        for marker in line["message"]["markers"]
    ]
    assert sorted(marker["ns"] for marker in markers) == ["margin", "tool", "tumor"]
    tumor = next(marker for marker in markers if marker["ns"] == "tumor")
    color = (tumor["color"]["r"], tumor["color"]["g"], tumor["color"]["b"])
    assert color == pytest.approx(MarginState.WARNING.color, abs=1e-7)


def test_constraint_is_repeated_between_steps(domain_id, content, make_step, start_receiver):
    with SessionPublisher(content, domain_id=domain_id, heartbeat_hz=200.0) as ros:
        receiver = start_receiver(f"{CONSTRAINT}:20")
        wait_for_one_subscriber(ros, topics.CONSTRAINT)
        step = make_step(0)
        ros.publish(step, StepTiming())
        beats = [line["message"] for line in receiver.messages()]
    numbers = [beat["seq"] for beat in beats]
    assert numbers == sorted(set(numbers))
    assert {ns(beat["header"]["stamp"]) for beat in beats} == {step.decision.stamp.ns}


@pytest.mark.parametrize("is_stopped", [False, True])
def test_step_published_too_late_is_stale(
    domain_id, content, make_step, start_receiver, is_stopped
):
    """It waited before, or the process is stopped after the first time was read."""
    policy = PublishPolicy(clock=False)
    late_ns = content.margins.stale_after_ns
    stopped = StepTiming(spent_ns=0, clock=lambda: late_ns)
    with SessionPublisher(content, domain_id=domain_id, heartbeat_hz=10.0, policy=policy) as ros:
        receiver = start_receiver(f"{CONSTRAINT}:1")
        wait_for_one_subscriber(ros, topics.CONSTRAINT)
        ros.publish(make_step(0), stopped if is_stopped else StepTiming(spent_ns=late_ns))
        (first,) = [line["message"] for line in receiver.messages()]
    assert (first["hold"], first["reasons"]) == (True, ["stale"])


@pytest.mark.parametrize(
    ("topic", "durability", "depth"),
    [
        (topics.TF, DurabilityPolicy.VOLATILE, 100),
        (topics.TF_STATIC, DurabilityPolicy.TRANSIENT_LOCAL, 1),
        (topics.ROBOT_DESCRIPTION, DurabilityPolicy.TRANSIENT_LOCAL, 1),
        (topics.MARKERS, DurabilityPolicy.TRANSIENT_LOCAL, 1),
        (topics.CONSTRAINT, DurabilityPolicy.VOLATILE, 1),
    ],
)
def test_publishers_have_the_declared_qos(domain_id, content, topic, durability, depth):
    with SessionPublisher(content, domain_id=domain_id) as ros:
        name = topic.name.replace("~", "/marginguard")
        publishers = ros.ros.node.get_publishers_info_by_topic(name)
        assert publishers
        for info in publishers:
            assert info.qos_profile.reliability == ReliabilityPolicy.RELIABLE
            assert info.qos_profile.durability == durability
    assert topic.qos.depth == depth


def test_case_without_robot_publishes_no_description(domain_id, content, make_step):
    freehand = replace(content, robot=None, robot_file=None)
    with SessionPublisher(freehand, domain_id=domain_id) as ros:
        ros.publish(replace(make_step(0), joints=None, links={}), StepTiming())
        names = dict(ros.ros.node.get_topic_names_and_types())
    assert "/robot_description" not in names
    assert "/tf" in names


def test_new_tumor_is_published_with_its_prepared_shapes(
    domain_id, content, make_step, start_receiver
):
    larger = SurfaceMesh("tumor", 2.0 * content.tumor.vertices_mm, content.tumor.faces)
    after = replace(content, tumor=larger)
    with SessionPublisher(content, domain_id=domain_id) as ros:
        receiver = start_receiver(f"{MARKERS}:4:latched")
        receiver.take(1)
        with pytest.raises(BridgeError, match="made of another tumour"):
            ros.prepare(content)(after)
        ros.prepare(after)(after)
        ros.publish(make_step(0), StepTiming())
        tumors = [
            marker
            for line in receiver.take(3)
            for marker in line["message"]["markers"]
            if marker["ns"] == "tumor"
        ]
    greens = [marker["color"]["g"] for marker in tumors]
    assert greens == [0.5, 1.0]  # grey until there is a step
    for marker in tumors:
        assert max(point["x"] for point in marker["points"]) == 0.02


def test_marker_of_a_structure_that_is_not_guarded_any_more_is_deleted(
    domain_id, content, make_step, start_receiver
):
    vessel = SurfaceMesh("vessel", content.tumor.vertices_mm, content.tumor.faces)
    edge = Transform.identity("needle", "vessel")
    both = content.with_structure(StructureContent(vessel, Role.FORBIDDEN, 1.0, 3.0), edge)
    with SessionPublisher(both, domain_id=domain_id) as ros:
        receiver = start_receiver(f"{MARKERS}:5:latched")
        lines = receiver.take(2)
        ros.prepare(content)(content)
        ros.publish(make_step(0), StepTiming())
        lines += receiver.take(3)
    markers = [marker for line in lines for marker in line["message"]["markers"]]
    found = [each for each in markers if each["ns"] == "structure/vessel"]
    assert [(each["action"], each["id"]) for each in found] == [(0, 0), (2, 0)]


def test_close_is_idempotent(domain_id, content):
    ros = SessionPublisher(content, domain_id=domain_id, heartbeat_hz=100.0)
    ros.close()
    ros.close()
    assert not ros.ros.is_open


@pytest.mark.parametrize("what", ["tumour", "registration"])
def test_new_tumor_or_registration_makes_the_margin_unknown_at_once(
    domain_id, content, make_step, start_receiver, what
):
    """No step lies in between, and the constraint before the change has not expired."""
    if what == "tumour":
        larger = SurfaceMesh("tumor", 2.0 * content.tumor.vertices_mm, content.tumor.faces)
        after = replace(content, tumor=larger)
    else:
        moved = Transform("reference", "robot_base", np.eye(3), [501.0, 0.0, -250.0])
        after = registered(content, given_registration(moved))
    with SessionPublisher(content, domain_id=domain_id) as ros:
        receiver = start_receiver(f"{CONSTRAINT}:2", f"{MARGIN_MM}:2", f"{COLOR}:2:latched")
        wait_for_one_subscriber(ros, topics.CONSTRAINT, topics.MARGIN_MM, topics.MARGIN_COLOR)
        ros.publish(make_step(0), StepTiming())
        lines = receiver.take(3)
        ros.prepare(after)(after)
        lines += receiver.messages()
    by_topic = {}
    for line in lines:
        by_topic.setdefault(line["topic"].removeprefix("/marginguard/"), []).append(line["message"])
    known, unknown = by_topic["constraint"]
    assert known["half_spaces"]
    assert (unknown["state"], unknown["hold"], unknown["reasons"]) == (3, True, ["starting"])
    assert unknown["half_spaces"] == []
    assert ns(unknown["valid_until"]) == 0
    assert unknown["model_id"] == after.model_id
    assert unknown["registration_id"] == after.registration_id
    assert (known["model_id"], known["registration_id"]) != (after.model_id, after.registration_id)
    assert math.isnan(by_topic["margin_mm"][1]["data"])
    assert by_topic["margin_color"][1]["g"] == 0.5
