"""Robots of other processes, described by parameter or topic, followed by tf or joint states."""

import json
import math
import queue
import signal
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from app.bridge import topics
from app.bridge.robot_description import (
    JOINT_STATES,
    DescriptionListener,
    DescriptionSource,
    RobotSettings,
)
from app.bridge.robots import FollowedRobot
from app.bridge.tf import TransformBuffer
from app.bridge.tf_topics import TfListener
from app.bridge.topics import LATCHED, Topic
from app.geometry import NS_PER_S
from app.robot import robot_from_text
from tests.waiting import DEADLINE_S, wait_until

pytestmark = pytest.mark.slow

PROCESS = Path(__file__).parent / "robot_process.py"


def described(name, tool=""):
    return f"""<robot name="{name}"><link name="base"/><link name="arm"/>{tool}
      <joint name="turn" type="continuous"><parent link="base"/><child link="arm"/>
      <origin xyz="0.25 0 0"/><axis xyz="0 0 1"/></joint></robot>"""


TOOL = """<link name="tool"/><joint name="end" type="fixed"><parent link="arm"/>
    <child link="tool"/></joint>"""


class RobotProcess:
    """``robot_process.py``, running until the end of the test."""

    def __init__(self, start, name, rate, by):
        self.start_ns = time.time_ns()
        self.rate = rate
        settings = {
            "namespace": name, "prefix": f"{name}/", "rate": rate, "by": by,
            "start_ns": self.start_ns, "urdf": described(name),
        }  # fmt: skip
        self.process = start(PROCESS, json.dumps(settings))

    def angle_at(self, stamp_ns):
        return self.rate * (stamp_ns - self.start_ns) * 1e-9

    def describe(self, text):
        self.process.send(json.dumps(text))


@pytest.fixture
def start_robot(start):
    return partial(RobotProcess, start)


def joint_angle(state):
    arm = state.poses[state.links.index("arm")]
    return math.atan2(arm[1, 0], arm[0, 0])


@pytest.mark.parametrize("joint_states", ["", JOINT_STATES])
def test_two_robots_move_independently(ros, start_robot, joint_states):
    buffer = TransformBuffer()
    TfListener(ros, buffer)
    processes = {
        "left": start_robot("left", 0.5, "parameter"),
        "right": start_robot("right", -2.0, "topic"),
    }
    robots = {
        name: FollowedRobot(
            ros,
            RobotSettings(name, namespace=name, tf_prefix=name),
            buffer,
            DescriptionSource(),
            joint_states=joint_states,
        )
        for name in processes
    }
    wait_until(
        lambda: all(robot.state(time.time_ns()).poses is not None for robot in robots.values())
    )
    for name, robot in robots.items():
        assert robot.robot.name == name
        for _ in range(20):
            state = robot.state(time.time_ns())
            assert state.root == f"{name}/base"
            error = joint_angle(state) - processes[name].angle_at(state.stamp_ns)
            assert math.remainder(error, math.tau) == pytest.approx(0.0, abs=1e-6)
            np.testing.assert_allclose(state.poses[1][:3, 3], [250.0, 0.0, 0.0], atol=1e-9)
    processes["left"].process.end(signal.SIGKILL)
    wait_until(lambda: robots["left"].state(time.time_ns()).is_stale)
    wait_until(lambda: not robots["right"].state(time.time_ns()).is_stale)


@pytest.mark.parametrize("joint_states", ["", JOINT_STATES])
def test_robot_is_set_before_its_state(ros, joint_states):
    observed = []

    class ObservedRobot(FollowedRobot):
        """Records its state after every assignment, as another thread may observe it."""

        def __setattr__(self, name, value):
            super().__setattr__(name, value)
            if hasattr(self, "_follower"):
                observed.append((self.state(1).links != (), self.robot is not None))

    robot = robot_from_text(described("arm"))
    ObservedRobot(ros, RobotSettings("arm"), TransformBuffer(), robot, joint_states=joint_states)
    assert observed[-1] == (True, True)
    assert (True, False) not in observed


@pytest.mark.parametrize("by", ["parameter", "topic"])
def test_changed_description_is_reloaded(ros, start_robot, by):
    process = start_robot("arm", 0.0, by)
    robots = queue.Queue()
    listener = DescriptionListener(
        ros, RobotSettings("arm", namespace="arm"), DescriptionSource(), robots.put
    )
    assert [link.name for link in robots.get(timeout=DEADLINE_S).links] == ["base", "arm"]
    process.describe("<robot name='broken'>")
    wait_until(lambda: listener.refused == 1)
    assert "not well-formed: " in listener.problem
    process.describe(described("arm", TOOL))
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
    listener = DescriptionListener(ros, RobotSettings("r"), DescriptionSource(node=""), robots.put)
    wait_until(lambda: listener.refused == 1)
    assert message in listener.problem
    assert len(listener.problem) <= 300
    publisher.publish(String(data=described("good")))
    assert robots.get(timeout=DEADLINE_S).name == "good"


def test_missing_description_is_a_problem(ros):
    robot = FollowedRobot(ros, RobotSettings("r"), TransformBuffer(), DescriptionSource())
    state = robot.state(NS_PER_S)
    assert (state.is_stale, state.poses, state.problems) == (True, None, ("no description yet",))
    robot.description.close()


def test_oversized_joint_state_is_refused(ros, other, robot):
    followed = FollowedRobot(
        ros, RobotSettings("r"), TransformBuffer(), robot, joint_states=JOINT_STATES
    )
    publisher = other.publisher(topics.JOINT_STATES)
    assert other.wait_for_subscribers(topics.JOINT_STATES, 1, DEADLINE_S)
    large = JointState(name=["n" * 1_000_000], position=[0.0])

    def is_refused():
        publisher.publish(large)  # again: a part of so large a message may be lost
        return followed.refused > 0

    wait_until(is_refused)
    assert ros.failures == 0
