"""Robots of other processes: two at once, described by parameter or topic, seen by tf or joints."""

import json
import math
import queue
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from app.bridge import topics
from app.bridge.qos import LATCHED, Topic
from app.bridge.robots import (
    JOINT_STATES,
    DescriptionListener,
    DescriptionSource,
    FollowedRobot,
    RobotSettings,
)
from app.bridge.tf import TransformBuffer
from app.bridge.tf.listener import TfListener
from app.geometry import NS_PER_S
from app.robot import robot_from_text

DEADLINE_S = 60.0
PROCESS = Path(__file__).parent / "robot_process.py"


def described(name, tool=""):
    return f"""<robot name="{name}"><link name="base"/><link name="arm"/>{tool}
      <joint name="turn" type="continuous"><parent link="base"/><child link="arm"/>
      <origin xyz="0.25 0 0"/><axis xyz="0 0 1"/></joint></robot>"""


TOOL = """<link name="tool"/><joint name="end" type="fixed"><parent link="arm"/>
    <child link="tool"/></joint>"""


class RobotProcess:
    """``robot_process.py`` at work until the test's end."""

    def __init__(self, name, rate, by):
        self.start_ns = time.time_ns()
        self.rate = rate
        settings = {
            "namespace": name, "prefix": f"{name}/", "rate": rate, "by": by,
            "start_ns": self.start_ns, "urdf": described(name),
        }  # fmt: skip
        self._process = subprocess.Popen(
            [sys.executable, str(PROCESS), json.dumps(settings)], stdin=subprocess.PIPE, text=True
        )

    def angle_at(self, stamp_ns):
        return self.rate * (stamp_ns - self.start_ns) * 1e-9

    def describe(self, text):
        self._process.stdin.write(json.dumps(text) + "\n")
        self._process.stdin.flush()

    def close(self):
        self._process.kill()
        self._process.wait()
        self._process.stdin.close()


@pytest.fixture
def start_robot(domain_id):
    started = []

    def start(*arguments):
        started.append(RobotProcess(*arguments))
        return started[-1]

    yield start
    for each in started:
        each.close()


def wait_until(condition):
    """Nothing here can wake us: states are computed when they are asked for."""
    until, pause = time.monotonic() + DEADLINE_S, threading.Event()
    while not condition():
        assert time.monotonic() < until
        pause.wait(0.02)


def turned_by(state):
    arm = state.poses[state.links.index("arm")]
    return math.atan2(arm[1, 0], arm[0, 0])


@pytest.mark.parametrize("joint_states", ["", JOINT_STATES])
def test_two_robots_move_on_their_own(ros, start_robot, joint_states):
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
            away = turned_by(state) - processes[name].angle_at(state.stamp_ns)
            assert math.remainder(away, math.tau) == pytest.approx(0.0, abs=1e-6)
            np.testing.assert_allclose(state.poses[1][:3, 3], [250.0, 0.0, 0.0], atol=1e-9)
    processes["left"].close()
    wait_until(lambda: robots["left"].state(time.time_ns()).is_stale)
    wait_until(lambda: not robots["right"].state(time.time_ns()).is_stale)


@pytest.mark.parametrize("joint_states", ["", JOINT_STATES])
def test_whoever_sees_a_state_sees_its_robot(ros, joint_states):
    seen = []

    class Watched(FollowedRobot):
        """Looks at itself between any two steps of its own, as another thread may."""

        def __setattr__(self, name, value):
            super().__setattr__(name, value)
            if hasattr(self, "_follower"):
                seen.append((self.state(1).links != (), self.robot is not None))

    robot = robot_from_text(described("arm"))
    Watched(ros, RobotSettings("arm"), TransformBuffer(), robot, joint_states=joint_states)
    assert seen[-1] == (True, True)
    assert (True, False) not in seen


@pytest.mark.parametrize("by", ["parameter", "topic"])
def test_a_description_that_changes_is_loaded_again(ros, start_robot, by):
    process = start_robot("arm", 0.0, by)
    said = queue.Queue()
    listener = DescriptionListener(
        ros, RobotSettings("arm", namespace="arm"), DescriptionSource(), said.put
    )
    assert [link.name for link in said.get(timeout=DEADLINE_S).links] == ["base", "arm"]
    process.describe("<robot name='broken'>")
    wait_until(lambda: listener.refused == 1)
    assert "not well-formed XML" in listener.problem
    process.describe(described("arm", TOOL))
    assert [link.name for link in said.get(timeout=DEADLINE_S).links] == ["base", "arm", "tool"]
    assert (listener.problem, listener.loaded) == ("", 2)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x" * 10_000_000, "bytes: 9437184 allowed"),
        ('<!DOCTYPE r [<!ENTITY a SYSTEM "file:///etc/passwd">]><robot name="&a;"/>', "DOCTYPE"),
        (
            '<robot name="r"><link name="a"><collision><geometry><mesh '
            'filename="file:///etc/hostname"/></geometry></collision></link></robot>',
            "outside the allowed mesh folders",
        ),
    ],
)
def test_what_strangers_send_is_refused(ros, other, text, message):
    said = queue.Queue()
    publisher = other.publisher(Topic("/robot_description", String, LATCHED))
    publisher.publish(String(data=text))
    listener = DescriptionListener(ros, RobotSettings("r"), DescriptionSource(node=""), said.put)
    wait_until(lambda: listener.refused == 1)
    assert message in listener.problem
    assert len(listener.problem) <= 300
    publisher.publish(String(data=described("good")))
    assert said.get(timeout=DEADLINE_S).name == "good"


def test_without_anyone_there_is_a_problem_and_an_end(ros):
    robot = FollowedRobot(ros, RobotSettings("r"), TransformBuffer(), DescriptionSource())
    state = robot.state(NS_PER_S)
    assert (state.is_stale, state.poses, state.problems) == (True, None, ("no description yet",))
    robot.description.close()


def test_joint_states_beyond_reason_are_refused_by_size(ros, other, robot):
    followed = FollowedRobot(
        ros, RobotSettings("r"), TransformBuffer(), robot, joint_states=JOINT_STATES
    )
    publisher = other.publisher(topics.JOINT_STATES)
    assert other.wait_for_subscribers(topics.JOINT_STATES, 1, DEADLINE_S)
    publisher.publish(JointState(name=["n" * 1_000_000], position=[0.0]))
    wait_until(lambda: followed.refused == 1)
    assert ros.failures == 0
