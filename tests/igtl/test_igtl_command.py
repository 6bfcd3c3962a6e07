"""``marginguard tracker igtl`` between a pyigtl server and a ROS receiver in separate processes."""

import math
import queue
import re
from collections.abc import Callable
from itertools import count
from typing import Any

import numpy as np
import pyigtl
import pytest

from tests.bridge.conftest import Start
from tests.bridge.processes import Child
from tests.igtl.conftest import pose
from tests.waiting import wait_until

pytestmark = pytest.mark.slow

TIME_S = 1_700_000_000.5
STAMP = {"sec": 1_700_000_000, "nanosec": 500_000_000}
OUT_OF_VIEW = {"TransformStatus": "OUT_OF_VIEW"}


@pytest.fixture
def start_command(start: Start) -> Callable[..., Child]:
    """``start_command(port, *options)``."""
    return lambda port, *options: start(
        "-m", "app.cli", "tracker", "igtl", "--host", "127.0.0.1", "--port", port, *options
    )


def test_received_transforms_are_published_on_ros(start_pyigtl, start_receiver, start_command):
    server = start_pyigtl()
    receiver = start_receiver(
        "/tracked_transforms:marginguard_msgs/msg/TrackedTransform:1000",
        "/tf:tf2_msgs/msg/TFMessage:1000",
        "/diagnostics:diagnostic_msgs/msg/DiagnosticArray:1000",
        wait=False,
    )
    command = start_command(server.port)
    receiver.wait_until_ready()
    received_messages: dict[str, list[dict[str, Any]]] = {"/tracked_transforms": [], "/tf": []}
    # The publishers may discover the receiver later than it discovers them: send repeatedly.
    tracked: dict[str, dict[str, Any]] = {}
    while len(tracked) < 2 or not received_messages["/tf"]:
        server.send(name="NeedleToTracker", matrix=pose(1, 2, 3), metadata=OUT_OF_VIEW)
        server.send(
            matrix=pose(1000, 2000, 3000), time_s=TIME_S, metadata={"TransformStatus": "OK"}
        )
        [received] = receiver.take(1)
        received_messages.setdefault(received["topic"], []).append(received["message"])
        tracked = {
            each["child_frame_id"]: each for each in received_messages["/tracked_transforms"]
        }

    stylus, needle = tracked["stylus"], tracked["needle"]
    assert (stylus["status"], needle["status"]) == (0, 3)
    assert stylus["header"] == {"frame_id": "tracker", "stamp": STAMP}
    assert stylus["transform"]["translation"] == {"x": 1.0, "y": 2.0, "z": 3.0}
    assert stylus["transform"]["rotation"]["z"] == pytest.approx(math.sqrt(0.5))
    assert math.isnan(needle["transform"]["translation"]["x"])
    assert math.isnan(needle["transform"]["rotation"]["w"])
    # A message holds the samples of one read; a repeated pose can be in it twice.
    on_tf = received_messages["/tf"][0]["transforms"][0]
    assert (on_tf["child_frame_id"], on_tf["header"]) == ("stylus", stylus["header"])
    assert on_tf["transform"] == stylus["transform"]

    server.send(name="Nonsense", matrix=pose(1, 2, 3))
    values: dict[str, str] = {}
    while "OpenIGTLink: refused (FrameError)" not in values:
        [received] = receiver.take(1)
        if received["topic"] == "/diagnostics":
            [status] = received["message"]["status"]
            values = {each["key"]: each["value"] for each in status["values"]}
    assert status["name"] == "marginguard: OpenIGTLink"
    assert status["level"] == 1
    assert "'Nonsense'" in values["last refusal"]
    assert values["OpenIGTLink: connections"] == "1"

    command.stop()
    assert f"connected to 127.0.0.1:{server.port}" in command.log.read_text()
    assert "Traceback" not in command.log.read_text()


def test_invalid_address_is_a_one_line_error(start):
    ended = start("-m", "app.cli", "tracker", "igtl", "--port", "0")
    assert ended.wait() == 2
    assert (
        ended.log.read_text()
        .splitlines()[-1]
        .startswith("marginguard: error: server is 'localhost' port 0; expected ")
    )


def test_images_of_a_server_are_published_with_their_stamps(listening, domain_id, start_command):
    from sensor_msgs.msg import Image

    from app.bridge import RosNode
    from app.bridge.convert import image_array
    from app.bridge.topics import NEWEST, Topic

    images: queue.Queue[Image] = queue.Queue()
    values = np.arange(30, dtype=np.uint16).reshape(1, 5, 6) * 1000
    with RosNode("viewer", domain_id=domain_id) as ros:
        ros.subscribe(Topic("/us/image", Image, NEWEST), images.put)
        command = start_command(listening.getsockname()[1], "--images", "/us/image")
        server, _ = listening.accept()
        with server:
            numbers = count(1)

            def packet(number: int) -> bytes:
                packed: bytes = pyigtl.ImageMessage(
                    values, np.eye(4), timestamp=TIME_S + number, device_name="Probe"
                ).pack()
                return packed

            # The subscriber is discovered at some time.
            wait_until(
                lambda: not images.empty(),
                lambda: server.sendall(packet(next(numbers))),
                pause_s=0.05,
                describe=command.log.read_text,
            )
            found = images.get()
            np.testing.assert_array_equal(image_array(found), values[0])
            assert (found.encoding, found.header.frame_id) == ("mono16", "image")
            assert found.header.stamp.nanosec == STAMP["nanosec"]
            last = next(numbers)
            assert STAMP["sec"] < found.header.stamp.sec < STAMP["sec"] + last
            damaged = packet(last)
            server.sendall(damaged[:-1] + bytes([damaged[-1] ^ 1]))
            wait_until(lambda: re.search("image not published.*checksum", command.log.read_text()))
    command.stop()
