"""Topics by name and type, with plain rclpy in another process."""

import threading
from pathlib import Path

import numpy as np
import pytest

from app.bridge.convert import (
    ConversionError,
    TopicPublisher,
    TopicSubscriber,
    UnknownTypeError,
    qos_profile,
)
from tests.bridge.conftest import CYCLONE_ON_THIS_MACHINE
from tests.waiting import DEADLINE_S

pytestmark = pytest.mark.slow

CYCLONE = Path(__file__).resolve().parents[1] / "cyclone_publisher.py"
PUBLISHER = Path(__file__).resolve().parent / "repeating_publisher.py"
POSE = "geometry_msgs/msg/PoseStamped"
NOTHING = {"x": 0.0, "y": 0.0, "z": 0.0}
ONE_METRE = "{'pose': {'position': {'x': 1.0, 'z': -0.25}}, 'header': {'frame_id': 'reference'}}"


@pytest.fixture
def publish(start_receiver):
    """``publish("/topic", "TYPE", "0.01", "{...}", "latched")``: another process publishes."""
    return lambda *arguments: start_receiver(*arguments, script=PUBLISHER)


def test_received_metres_become_millimetres(ros, publish):
    received = threading.Event()
    subscriber = TopicSubscriber(ros, "PoseStamped", "/target", changed=received.set)
    assert subscriber.values is None
    publish("/target", POSE, "0.01", ONE_METRE)
    assert received.wait(DEADLINE_S)
    values = subscriber.values
    assert values["pose"]["position"] == {"x": 1000.0, "y": 0.0, "z": -250.0}
    assert values["pose"]["orientation"]["w"] == 1.0
    assert values["header"]["frame_id"] == "reference"
    assert subscriber.message.pose.position.x == 1.0
    assert subscriber.count >= 1


def test_messages_of_cyclone_dds_are_received(ros, start_receiver):
    received = threading.Event()
    subscriber = TopicSubscriber(ros, "PoseArray", "/poses", changed=received.set)
    start_receiver("250", script=CYCLONE, environment=CYCLONE_ON_THIS_MACHINE)
    assert received.wait(DEADLINE_S)
    poses = subscriber.values["poses"]
    assert [pose["position"] for pose in poses] == [
        {"x": 1000.0 * number, "y": 0.0, "z": 500.0} for number in range(250)
    ]


def test_published_millimetres_become_metres(ros, start_receiver):
    publisher = TopicPublisher(ros, "PoseStamped", "~/target")
    receiver = start_receiver(f"/marginguard/target:{POSE}:1")
    assert ros.wait_for_subscribers(publisher.topic, 1, timeout_s=DEADLINE_S)
    values = {"pose": {"position": {"x": 12.5}, "orientation": {"w": 1}}}
    assert publisher.publish(values) == 1
    (line,) = receiver.messages()
    assert line["message"]["pose"]["position"] == {"x": 0.0125, "y": 0.0, "z": 0.0}
    assert line["message"]["pose"]["orientation"]["w"] == 1.0


FORCE = {"force": {"x": 0.0, "y": 0.0, "z": 3.0}, "torque": NOTHING}
SHORT_NAMES = {
    "Empty": ("std_msgs/msg/Empty", {}, {}),
    "String": ("std_msgs/msg/String", {"data": "ü"}, {"data": "ü"}),
    "Bool": ("std_msgs/msg/Bool", {"data": True}, {"data": True}),
    "Int": ("std_msgs/msg/Int64", {"data": -(2**62)}, {"data": -(2**62)}),
    "Double": ("std_msgs/msg/Float64", {"data": 1}, {"data": 1.0}),
    "Joy": (
        "sensor_msgs/msg/Joy",
        {"axes": np.array([0.5, -1.0]), "buttons": [1, 0]},
        {"axes": [0.5, -1.0], "buttons": [1, 0]},
    ),
    "WrenchStamped": (
        "geometry_msgs/msg/WrenchStamped",
        {"wrench": {"force": {"z": 3.0}}},
        {"wrench": FORCE},
    ),
}


def test_short_type_names_of_slicerros2(ros, start_receiver):
    latched = qos_profile(durability="transient_local")
    for short, (_, values, _) in SHORT_NAMES.items():
        TopicPublisher(ros, short, f"~/{short}", latched).publish(values)
    names = [f"/marginguard/{short}:{kind}:1:latched" for short, (kind, *_) in SHORT_NAMES.items()]
    lines = start_receiver(*names).messages()
    assert len(lines) == len(SHORT_NAMES)
    for line in lines:
        _, _, expected = SHORT_NAMES[line["topic"].removeprefix("/marginguard/")]
        assert expected.items() <= line["message"].items()


def test_late_subscriber_gets_the_latched_message(ros, publish):
    publish("/notice", "std_msgs/msg/String", "0", "{'data': 'ready'}", "latched")
    received = threading.Event()
    latched = qos_profile(depth=1, durability="transient_local")
    subscriber = TopicSubscriber(ros, "String", "/notice", latched, changed=received.set)
    assert received.wait(DEADLINE_S)
    assert subscriber.values == {"data": "ready"}


def test_incompatible_qos_is_reported(ros, publish, capfd):
    subscriber = TopicSubscriber(ros, "String", "/lossy", qos_profile(reliability="reliable"))
    fitting, received = qos_profile(reliability="best_effort"), threading.Event()
    TopicSubscriber(ros, "String", "/lossy", fitting, changed=received.set)
    publish("/lossy", "std_msgs/msg/String", "0.01", "{'data': 'x'}", "best_effort")
    assert received.wait(DEADLINE_S)
    assert subscriber.count == 0
    assert ros.incompatible == {"/lossy": "RELIABILITY"}
    assert "because of incompatible RELIABILITY" in capfd.readouterr().err


def test_high_rate_messages_are_deserialised_only_on_read(ros, publish):
    # The other process publishes as fast as it can; only one message is deserialised.
    many = threading.Event()
    subscriber = TopicSubscriber(ros, POSE, "/fast", qos_profile(depth=1), changed=lambda: count())

    def count():
        if subscriber.count >= 2000:
            many.set()

    publish("/fast", POSE, "0.0001", ONE_METRE)
    assert many.wait(DEADLINE_S)
    assert subscriber.values["pose"]["position"]["x"] == 1000.0
    assert ros.failures == 0


def test_invalid_value_is_not_published(ros):
    publisher = TopicPublisher(ros, "Double", "~/x")
    with pytest.raises(ConversionError, match=r"Float64\.data is 'a'"):
        publisher.publish({"data": "a"})
    assert publisher.count == 0


def test_invalid_bytes_are_refused(ros):
    subscriber = TopicSubscriber(ros, "String", "/x")
    subscriber._on_message(b"\x00\x01\x00\x00\xff\xff\xff\xff")
    with pytest.raises(ConversionError, match="8 bytes are not a valid String"):
        _ = subscriber.values
    assert subscriber.values is None


def test_invalid_names_and_policies_are_refused(ros):
    with pytest.raises(UnknownTypeError, match="Nothing"):
        TopicPublisher(ros, "std_msgs/Nothing", "/x")
    for make in (TopicPublisher, TopicSubscriber):
        with pytest.raises(ConversionError, match="topic 'two words' cannot be used"):
            make(ros, "String", "two words")
    for wrong in ({"depth": 0}, {"reliability": "good"}, {"durability": "for ever"}):
        with pytest.raises(ConversionError):
            qos_profile(**wrong)
