"""Robots of other processes, described by parameter or topic."""

import json
import queue
from pathlib import Path

import pytest
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters
from std_msgs.msg import String

from app.bridge.robot_description import (
    DescriptionListener,
    DescriptionSource,
    RobotSettings,
)
from app.bridge.topics import LATCHED, Topic
from tests.waiting import DEADLINE_S, wait_until

pytestmark = pytest.mark.slow

PROCESS = Path(__file__).parent / "robot_process.py"
SOURCES = {
    "parameter": DescriptionSource("/robot_state_publisher", "robot_description"),
    "topic": DescriptionSource(topic="robot_description"),
}


def described(name, tool=""):
    return f"""<robot name="{name}"><link name="base"/><link name="arm"/>{tool}
      <joint name="turn" type="continuous"><parent link="base"/><child link="arm"/>
      <origin xyz="0.25 0 0"/><axis xyz="0 0 1"/></joint></robot>"""


TOOL = """<link name="tool"/><joint name="end" type="fixed"><parent link="arm"/>
    <child link="tool"/></joint>"""


@pytest.mark.parametrize("by", ["parameter", "topic"])
def test_changed_description_is_reloaded(ros, start, by):
    process = start(PROCESS, by, described("arm"))
    robots = queue.Queue()
    listener = DescriptionListener(ros, RobotSettings("arm"), SOURCES[by], robots.put)
    assert [link.name for link in robots.get(timeout=DEADLINE_S).links] == ["base", "arm"]
    process.send(json.dumps("<robot name='broken'>"))
    wait_until(lambda: listener.refused == 1)
    assert "not well-formed: " in listener.problem
    process.send(json.dumps(described("arm", TOOL)))
    assert [link.name for link in robots.get(timeout=DEADLINE_S).links] == ["base", "arm", "tool"]
    assert (listener.problem, listener.loaded) == ("", 2)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x" * 10_000_000, "bytes; expected at most 9437184"),
        ('<!DOCTYPE r [<!ENTITY a SYSTEM "file:///etc/passwd">]><robot name="&a;"/>', "DOCTYPE"),
        (
            '<robot name="r"><link name="a"><collision><geometry><mesh '
            'filename="file:///etc/hostname"/></geometry></collision></link></robot>',
            "outside the allowed mesh folders",
        ),
    ],
)
def test_invalid_description_is_refused(ros, other, text, message):
    robots = queue.Queue()
    publisher = other.publisher(Topic("/robot_description", String, LATCHED))
    publisher.publish(String(data=text))
    listener = DescriptionListener(ros, RobotSettings("r"), SOURCES["topic"], robots.put)
    wait_until(lambda: listener.refused == 1)
    assert message in listener.problem
    assert len(listener.problem) <= 300
    publisher.publish(String(data=described("good")))
    assert robots.get(timeout=DEADLINE_S).name == "good"


def test_parameter_of_an_unknown_type_is_refused(ros, other):
    def answer(_, response):
        response.values = [ParameterValue(type=77)]
        return response

    for service in (GetParameters, SetParameters):
        name = "get" if service is GetParameters else "set"
        other.node.create_service(service, f"/odd/{name}_parameters", answer)
    source = DescriptionSource("/odd", "robot_description")
    listener = DescriptionListener(ros, RobotSettings("r"), source, pytest.fail)
    wait_until(lambda: listener.refused == 1)
    assert "77" in listener.problem
