"""A publisher that is asked to stop leaves the ROS graph itself, with its heartbeat running."""

import signal
import subprocess
import sys

import pytest

SPEAKER = """
import threading
from std_msgs.msg import String
from app.bridge import RosNode, terminate_cleanly
from app.bridge.heartbeat import Heartbeat
from app.bridge.qos import STREAM, Topic

with terminate_cleanly(), RosNode("speaker") as ros:
    publisher = ros.publisher(Topic("~/news", String, STREAM))
    heartbeat = Heartbeat(lambda text, seq: publisher.publish(String(data=f"{text} {seq}")), 500.0)
    heartbeat.newest("beat")
    try:
        print("up", flush=True)
        threading.Event().wait()
    finally:
        heartbeat.close()
        print("left", flush=True)
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_cleanly_with_messages_in_flight(
    domain_id, project_root, start_receiver, number
):
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
        start_receiver("/speaker/news:std_msgs/msg/String:20").messages()
        process.send_signal(number)
        assert process.stdout.read() == "left\n"
        assert process.stderr is not None
        error = process.stderr.read()
        assert process.wait(30) in {-signal.SIGINT, 128 + number}
    finally:
        process.kill()
        process.wait()
    assert "KeyboardInterrupt" in error if number == signal.SIGINT else error == ""
