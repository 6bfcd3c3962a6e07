"""Sending transforms as PLUS does: to our own client, to pyigtl, and to clients that misbehave."""

import queue
import socket

import numpy as np
import pyigtl
import pytest

from app.geometry import Stamp, TrackedTransform, TrackingStatus, Transform
from app.igtl import IgtlSource, PoseServer
from app.igtl.framing import IgtlError
from app.igtl.pose_messages import MAX_CLIENTS, transform_message
from tests.waiting import wait_until

STAMP = Stamp(1_700_000_000_123_456_789)
POSE = Transform.from_rotation_vector((0.1, -0.2, 0.3), (1, 2, 3), target="tracker", source="tip")
GOOD = TrackedTransform(POSE, STAMP, TrackingStatus.OK)
LOST = TrackedTransform.lost("tracker", "needle", STAMP, TrackingStatus.OUT_OF_VIEW)


@pytest.fixture
def server():
    with PoseServer(0) as found:
        yield found


def test_our_client_receives_poses_status_and_time(server):
    received = queue.Queue()
    with IgtlSource("127.0.0.1", server.port, received.put):
        samples = []

        def exchange():
            server.send([GOOD, LOST])
            while not received.empty():
                samples.extend(received.get())

        wait_until(lambda: {s.status for s in samples} >= {GOOD.status, LOST.status}, exchange)
    good = next(s for s in samples if s.status is TrackingStatus.OK)
    lost = next(s for s in samples if s.source == "needle")
    assert (good.target, good.source) == ("tracker", "tip")
    np.testing.assert_allclose(good.transform.matrix, POSE.matrix, atol=1e-6)
    assert abs(good.stamp.ns - STAMP.ns) <= 1
    assert (lost.transform, lost.status) == (None, TrackingStatus.OUT_OF_VIEW)


def test_client_of_pyigtl_receives_poses(server):
    client = pyigtl.OpenIGTLinkClient("127.0.0.1", server.port)
    try:
        found = []

        def exchange():
            server.send([GOOD, LOST])
            found.extend(client.get_latest_messages())

        wait_until(lambda: found, exchange)
    finally:
        client.stop()
    assert {each.device_name for each in found} == {"TipToTracker"}, "version 1 has no status"
    np.testing.assert_allclose(found[0].matrix, POSE.matrix, atol=1e-6)
    assert found[0].timestamp == pytest.approx(STAMP.ns * 1e-9, abs=1e-6)


def test_client_that_does_not_read_is_disconnected_without_waiting(server):
    with socket.create_connection(("127.0.0.1", server.port)):
        wait_until(lambda: server.clients == 1)
        wait_until(lambda: server.clients == 0, lambda: server.send([GOOD] * 1000))


def test_client_that_leaves_is_forgotten_and_others_are_limited(server):
    with socket.create_connection(("127.0.0.1", server.port)):
        wait_until(lambda: server.clients == 1)
    wait_until(lambda: server.clients == 0, lambda: server.send([GOOD]))
    connections = [
        socket.create_connection(("127.0.0.1", server.port)) for _ in range(MAX_CLIENTS + 1)
    ]
    assert connections[-1].recv(1) == b"", "one too many is closed"
    assert server.clients == MAX_CLIENTS
    for each in connections:
        each.close()


def test_port_in_use_is_one_line(server):
    with pytest.raises(IgtlError, match=rf"OpenIGTLink port {server.port}: .*; expected a free p"):
        PoseServer(server.port)


def test_lost_sample_has_no_message_of_version_1():
    assert transform_message(LOST, 1) is None
    assert transform_message(LOST, 2) is not None
