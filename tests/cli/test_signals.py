"""A publisher that is asked to stop leaves the ROS graph itself, with its heartbeat running."""

import signal
import subprocess
import sys
import threading

import pytest

from app.cli.signals import SIGNALS, stop_on_signals
from tests.ros_domain import domain_id as domain_id

SPEAKER = """
import sys
import threading
from std_msgs.msg import String
from app.bridge import RosNode
from app.bridge.heartbeat import Heartbeat
from app.bridge.qos import STREAM, Topic
from app.cli.signals import stop_on_signals

over = threading.Event()
with stop_on_signals(over.set) as received, RosNode("speaker") as ros:
    publisher = ros.publisher(Topic("~/news", String, STREAM))
    heartbeat = Heartbeat(lambda text, seq: publisher.publish(String(data=f"{text} {seq}")), 500.0)
    heartbeat.newest("beat")
    print("up", flush=True)
    over.wait()
    heartbeat.close()
print("left", flush=True)
sys.exit(received.exit_status)
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_cleanly_with_messages_in_flight(domain_id, project_root, number):
    process = subprocess.Popen(
        [sys.executable, "-c", SPEAKER],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=project_root,
    )
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "up\n"
        process.send_signal(number)
        assert process.stdout.read() == "left\n"
        assert process.stderr is not None
        assert process.stderr.read() == ""
        assert process.wait(30) == 128 + number
    finally:
        process.kill()
        process.wait()


def test_the_handlers_that_were_there_come_back():
    before = {number: signal.getsignal(number) for number in SIGNALS}
    with stop_on_signals(lambda: None) as received:
        assert all(signal.getsignal(number) != before[number] for number in SIGNALS)
    assert {number: signal.getsignal(number) for number in SIGNALS} == before
    assert received.exit_status == 0


def test_a_signal_calls_stop_and_raises_nothing():
    stopped = threading.Event()
    with stop_on_signals(stopped.set) as received:
        signal.raise_signal(signal.SIGINT)
        assert stopped.wait(30.0)
    assert received.exit_status == 130
