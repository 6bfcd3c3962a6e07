"""The node alone: other processes hear it, and closing it leaves nothing behind."""

import subprocess
import sys
import threading

import pytest
import rclpy
from std_msgs.msg import String

from app.bridge.errors import BridgeError
from app.bridge.node import RosNode
from app.bridge.qos import LATCHED, STREAM, Topic

NEWS = Topic("~/news", String, STREAM)
STANDING = Topic("~/standing", String, LATCHED)
STRING = "std_msgs/msg/String"


def test_a_subscriber_that_was_waited_for_gets_every_message(domain_id, start_receiver):
    with RosNode("speaker", domain_id=domain_id) as ros:
        publisher = ros.publisher(NEWS)
        receiver = start_receiver(f"/speaker/news:{STRING}:50")
        assert ros.wait_for_subscribers(NEWS, 1, timeout_s=30.0)
        for number in range(50):
            publisher.publish(String(data=str(number)))
        received = receiver.messages()
    assert [line["message"]["data"] for line in received] == [str(n) for n in range(50)]


def test_a_late_joiner_gets_the_last_latched_message(domain_id, start_receiver):
    with RosNode("speaker", namespace="room_1", domain_id=domain_id) as ros:
        publisher = ros.publisher(STANDING)
        publisher.publish(String(data="old"))
        publisher.publish(String(data="new"))
        received = start_receiver(f"/room_1/speaker/standing:{STRING}:1:latched").messages()
    assert [line["message"]["data"] for line in received] == ["new"]


def test_what_was_published_before_closing_still_arrives(domain_id, start_receiver):
    with RosNode("speaker", domain_id=domain_id) as ros:
        publisher = ros.publisher(NEWS)
        receiver = start_receiver(f"/speaker/news:{STRING}:100")
        assert ros.wait_for_subscribers(NEWS, 1, timeout_s=30.0)
        for number in range(100):
            publisher.publish(String(data=f"{number} {'x' * 10_000}"))
    assert len(receiver.messages()) == 100


def test_what_a_full_socket_has_dropped_is_asked_for_before_closing(domain_id, start_receiver):
    # 2 MB at once for a process that does not listen: ten times what a socket holds at first.
    with RosNode("speaker", domain_id=domain_id) as ros:
        publisher = ros.publisher(NEWS)
        receiver = start_receiver(f"/speaker/news:{STRING}:100")
        assert ros.wait_for_subscribers(NEWS, 1, timeout_s=30.0)
        with receiver.held():
            for _ in range(100):
                publisher.publish(String(data="x" * 20_000))
    assert len(receiver.messages()) == 100


def test_waiting_for_nobody_ends_in_time(domain_id):
    with RosNode("speaker", domain_id=domain_id) as ros:
        ros.publisher(NEWS)
        assert not ros.wait_for_subscribers(NEWS, 1, timeout_s=0.01)


def test_closing_ends_the_thread_and_can_be_repeated(domain_id):
    before = set(threading.enumerate())
    ros = RosNode("speaker", domain_id=domain_id)
    assert ros.is_open
    assert set(threading.enumerate()) - before
    ros.close()
    ros.close()
    assert not ros.is_open
    assert set(threading.enumerate()) == before


def test_a_callback_cannot_close_its_own_node(domain_id):
    with RosNode("speaker", domain_id=domain_id) as ros:
        refused, done = [], threading.Event()

        def close():
            try:
                ros.close()
            except BridgeError as error:
                refused.append(str(error))
            done.set()

        ros.call_soon(close)
        assert done.wait(30.0)
        assert "'speaker'" in refused[0]
        assert ros.is_open
    assert not ros.is_open


def test_on_a_closed_node_nothing_is_called(domain_id):
    ros = RosNode("speaker", domain_id=domain_id)
    ros.close()
    called = []
    ros.call_soon(lambda: called.append("soon"))
    ros.call(lambda: called.append("now"))
    ros.wake()
    assert not called


def test_callbacks_that_fail_are_all_counted_and_said_once_a_second(domain_id, capfd):
    def fail():
        raise ValueError("no such tool")

    with RosNode("speaker", domain_id=domain_id) as ros:
        for _ in range(100):
            ros.call(fail)
        ros.call(lambda: None)  # the last failure is counted after its call has ended
        assert ros.failures == 100
    said = capfd.readouterr().err.count("ValueError: no such tool")
    assert 1 <= said < 10


FORGETFUL = """
import atexit
from app.bridge import RosNode
told = []
atexit.register(lambda: print(told[0].is_open))  # the last one of all: after the node's own
told.append(RosNode("forgotten"))
"""


def test_a_node_that_nobody_closes_is_closed_before_python_ends(domain_id):
    # Inside ROS, its thread would abort the program: mostly, not always, so it is asked instead.
    ended = subprocess.run(
        [sys.executable, "-c", FORGETFUL], capture_output=True, text=True, timeout=60.0
    )
    assert (ended.returncode, ended.stdout) == (0, "False\n"), ended.stderr


def test_the_default_context_is_left_alone(domain_id):
    with RosNode("speaker", domain_id=domain_id):
        assert not rclpy.ok()


def test_two_nodes_live_in_one_process(domain_id):
    with RosNode("one", domain_id=domain_id) as one, RosNode("two", domain_id=domain_id) as two:
        one.close()
        assert two.is_open


def test_ros_arguments_remap(domain_id, start_receiver):
    remap = ("--ros-args", "-r", "~/standing:=/elsewhere")
    with RosNode("speaker", domain_id=domain_id, ros_args=remap) as ros:
        ros.publisher(STANDING).publish(String(data="here"))
        received = start_receiver(f"/elsewhere:{STRING}:1:latched").messages()
    assert received[0]["message"]["data"] == "here"


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("name", "namespace"), [("two words", ""), ("", ""), ("1st", ""), ("speaker", "two words")]
)
def test_a_name_that_ros_refuses_is_one_line(domain_id, name, namespace):
    with pytest.raises(BridgeError, match="cannot be started") as caught:
        RosNode(name, namespace=namespace, domain_id=domain_id)
    assert "\n" not in str(caught.value)
