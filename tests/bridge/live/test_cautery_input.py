"""The state of the cautery from a ROS topic and from OpenIGTLink STRING messages."""

import pyigtl
import pytest
from std_msgs.msg import Bool

from app.bridge.live.sources import IgtlActivation, TopicActivation
from app.bridge.topics import STREAM, Topic
from app.case import Activation, ActivationTrail
from app.igtl.framing import HEADER_BYTES, Header, read_header
from tests.waiting import wait_until

pytestmark = pytest.mark.slow

TOPIC = Topic("/generator/active", Bool, STREAM)
LIMIT_NS = 1000


def test_topic_says_on_and_off_until_it_is_too_old(ros, other):
    now = [0]
    cautery = TopicActivation(ros, TOPIC.name, ActivationTrail(LIMIT_NS), lambda: now[0])
    publisher = other.publisher(TOPIC)
    assert cautery.state() is Activation.UNKNOWN
    for on, state in ((True, Activation.ON), (False, Activation.OFF)):
        wait_until(
            lambda state=state: cautery.state() is state,  # type: ignore[misc]
            lambda on=on: publisher.publish(Bool(data=on)),  # type: ignore[misc]
        )
    now[0] += LIMIT_NS + 1
    assert cautery.state() is Activation.UNKNOWN
    assert cautery.counts()[f"{TOPIC.name}: messages"] >= 2


def test_two_publishers_make_the_state_unknown(ros, other):
    cautery = TopicActivation(ros, TOPIC.name, ActivationTrail(LIMIT_NS), lambda: 0)
    publishers = [other.publisher(TOPIC), ros.publisher(TOPIC)]

    def send() -> None:
        for publisher in publishers:
            publisher.publish(Bool(data=True))

    wait_until(lambda: cautery.counts().get(f"{TOPIC.name}: of two publishers", 0) > 2, send)
    assert cautery.state() is Activation.UNKNOWN


def packet(text: str, device: str = "Cautery") -> tuple[Header, bytes]:
    content = pyigtl.StringMessage(text, device_name=device).pack()
    return read_header(content[:HEADER_BYTES]), content[HEADER_BYTES:]


def test_string_of_the_device_says_on_and_off():
    cautery = IgtlActivation("Cautery", ActivationTrail(LIMIT_NS), lambda: 0)
    for text, state in (
        ("ON", Activation.ON),
        ("0", Activation.OFF),
        ("true", Activation.ON),
        ("standby", Activation.UNKNOWN),
        (" off ", Activation.OFF),
    ):
        cautery.receive(*packet(text))
        assert cautery.state() is state
    cautery.receive(*packet("on", "Other"))
    assert cautery.state() is Activation.OFF
    assert cautery.counts() == {"cautery: messages": 5, "cautery: refused": 1}
    header, body = packet("on")
    cautery.receive(header, body[:-1] + b"x")
    assert cautery.state() is Activation.UNKNOWN
