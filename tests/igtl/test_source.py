"""`IgtlSource` with a pyigtl server in another process, and with invalid data on a socket."""

import queue
import socket
import struct
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pyigtl
import pytest

from app.geometry import Stamp, TrackedTransform, TrackingStatus
from app.igtl import Header, IgtlError, IgtlSource, read_image
from app.igtl.framing import IgtlChecksumError, start_tracking_request
from app.igtl.source import Backoff
from tests.igtl.conftest import PyigtlServer, pose
from tests.oracles.pyigtl_peer import message
from tests.waiting import DEADLINE_S

StartPyigtl = Callable[..., PyigtlServer]


class SourceListener:
    """A source with queues of its samples and status texts."""

    def __init__(self, port: int, **options: Any) -> None:
        self._samples: queue.Queue[TrackedTransform] = queue.Queue()
        self._statuses: queue.Queue[str] = queue.Queue()
        self.source = IgtlSource(
            "127.0.0.1",
            port,
            lambda samples: [self._samples.put(sample) for sample in samples],
            changed=self._statuses.put,
            backoff=Backoff(0.01, 0.1),
            **options,
        )

    def sample(self) -> TrackedTransform:
        return self._samples.get(timeout=DEADLINE_S)

    def status(self, beginning: str) -> str:
        while not (status := self._statuses.get(timeout=DEADLINE_S)).startswith(beginning):
            pass
        return status

    @property
    def is_empty(self) -> bool:
        return self._samples.empty()


Listen = Callable[..., SourceListener]


@pytest.fixture
def listen() -> Iterator[Listen]:
    started: list[SourceListener] = []

    def start(port: int, **options: Any) -> SourceListener:
        started.append(SourceListener(port, **options))
        return started[-1]

    yield start
    for each in started:
        each.source.close()


def test_poses_and_statuses_of_a_pyigtl_server_are_received(start_pyigtl, listen):
    server = start_pyigtl()
    listening = listen(server.port)
    listening.status("connected to 127.0.0.1")
    server.send(matrix=pose(1, 2, 3), time_s=1_700_000_000.5, metadata={"TransformStatus": "OK"})
    server.send(type="STRING", name="Log", string="hello")
    server.send(matrix=pose(1, 2, 3), metadata={"TransformStatus": "OUT_OF_VIEW"})
    server.send(
        type="TDATA",
        name="Tracker",
        elements=[["NeedleToTracker", 2, pose(4, 5, 6)], ["CauteryToTracker", 2, pose(7, 8, 9)]],
        metadata={"NeedleToTrackerStatus": "OK", "CauteryToTrackerStatus": "MISSING"},
    )

    samples = [listening.sample() for _ in range(4)]

    assert [(each.source, each.status) for each in samples] == [
        ("stylus", TrackingStatus.OK),
        ("stylus", TrackingStatus.OUT_OF_VIEW),
        ("needle", TrackingStatus.OK),
        ("cautery", TrackingStatus.MISSING),
    ]
    assert samples[0].stamp.ns == 1_700_000_000_500_000_000
    assert samples[0].transform is not None
    np.testing.assert_array_equal(samples[0].transform.matrix, pose(1, 2, 3))
    counts = listening.source.counts()
    assert counts["OpenIGTLink: samples"] == 4
    assert counts["OpenIGTLink: messages of other types"] == 1
    assert not any("refused" in key for key in counts)


def test_killed_server_is_reconnected(start_pyigtl, listen):
    server = start_pyigtl()
    listening = listen(server.port)
    listening.status("connected")
    server.send(matrix=pose(1, 0, 0), time_s=1.0)
    assert listening.sample().stamp.ns == 1_000_000_000

    server.kill()
    assert "retrying in" in listening.status("lost")
    assert "retrying in" in listening.status("cannot reach")
    assert not listening.source.connected

    again = start_pyigtl(server.port)
    listening.status("connected")
    again.send(matrix=pose(2, 0, 0), time_s=2.0)
    assert listening.sample().stamp.ns == 2_000_000_000
    assert listening.is_empty
    assert listening.source.counts()["OpenIGTLink: connections"] == 2


def accepted(listening: socket.socket) -> socket.socket:
    server, _ = listening.accept()
    server.settimeout(DEADLINE_S)
    request = start_tracking_request()
    assert server.recv(len(request), socket.MSG_WAITALL) == request
    return server


def test_invalid_header_closes_the_connection_and_source_reconnects(listening, listen):
    source = listen(listening.getsockname()[1])
    good = message(matrix=pose(1, 2, 3)).pack()
    for garbage in (b"\xff" * 4096, b"HTTP/1.1 400 Bad Request\r\n" * 10):
        with accepted(listening) as server:
            server.sendall(garbage)
            assert "OpenIGTLink header begins with" in source.status("lost")
    with accepted(listening) as server:
        server.sendall(good)
        assert source.sample().source == "stylus"
    assert source.source.counts()["OpenIGTLink: refused (IgtlFramingError)"] == 2


def test_partial_message_is_discarded_on_reconnection(listening, listen):
    source = listen(listening.getsockname()[1])
    old, new = (message(matrix=pose(1, 2, 3), time_s=time_s).pack() for time_s in (1.0, 2.0))
    for cut in (20, 58, 100):
        with accepted(listening) as server:
            server.sendall(old[:cut])
        source.status("lost")
    with accepted(listening) as server:
        for begin in range(0, len(new), 7):
            server.sendall(new[begin : begin + 7])
        assert source.sample().stamp.ns == 2_000_000_000
        assert source.is_empty


def test_silent_server_is_disconnected(listening, listen):
    source = listen(listening.getsockname()[1], silence_s=0.05)
    with accepted(listening) as server:
        server.sendall(message(matrix=pose(1, 2, 3)).pack()[:-1])
        assert "no message for 0.05 s" in source.status("lost")
        assert server.recv(1) == b""


def test_oversized_message_is_skipped(listening, listen):
    source = listen(listening.getsockname()[1])
    with accepted(listening) as server:
        huge = struct.pack(">H12s20sQQQ", 2, b"TRANSFORM", b"AToB", 1 << 32, 10_000_000, 0)
        server.sendall(huge + bytes(10_000_000) + message(matrix=pose(1, 2, 3)).pack())
        assert source.sample().source == "stylus"
    assert source.source.counts()["OpenIGTLink: refused (IgtlLimitError)"] == 1
    assert "10000000 bytes; expected at most 65536" in source.source.last_refusal


def test_exception_in_deliver_is_raised_on_close(listening):
    def fails(samples: object) -> None:
        raise ValueError("deliver is broken")

    source = IgtlSource("127.0.0.1", listening.getsockname()[1], fails)
    with accepted(listening) as server:
        server.sendall(message(matrix=pose(1, 2, 3)).pack())
        assert server.recv(1) == b""
    with pytest.raises(IgtlError, match="deliver is broken"):
        source.close()
    source.close()


@pytest.mark.parametrize(("host", "port"), [("", 18944), ("localhost", 0), ("localhost", 65536)])
def test_invalid_address_is_refused(host, port):
    with pytest.raises(IgtlError, match="; expected a host name and a port from 1 to 65535"):
        IgtlSource(host, port, lambda samples: None)


def test_problem_names_the_server_and_what_to_do_until_it_is_connected(start_pyigtl):
    server, backoff = start_pyigtl(), Backoff(60.0, 60.0)
    statuses: queue.Queue[str] = queue.Queue()
    with IgtlSource(
        "127.0.0.1", server.port, lambda samples: None, changed=statuses.put, backoff=backoff
    ) as source:
        assert statuses.get(timeout=DEADLINE_S).startswith("connected")
        assert source.problem == ""
        server.kill()
        while not statuses.get(timeout=DEADLINE_S).startswith("lost"):
            pass
        assert source.problem.startswith(f"OpenIGTLink server 127.0.0.1:{server.port}: lost")
        assert "expected a running server: start it" in source.problem


def test_unknown_host_is_reported(listen):
    statuses: queue.Queue[str] = queue.Queue()
    with IgtlSource("x" * 70, 18944, lambda samples: None, changed=statuses.put):
        assert statuses.get(timeout=DEADLINE_S).startswith("cannot reach")


def test_images_are_passed_on_unread_and_poses_are_read_beside_them(listening, listen):
    images: queue.Queue[tuple[Header, bytes]] = queue.Queue()
    source = listen(listening.getsockname()[1], images=lambda *found: images.put(found))
    server, _ = listening.accept()
    values = np.arange(1, 601 * 401 + 1, dtype=np.uint64).astype(np.uint8).reshape(1, 601, 401)
    packet = pyigtl.ImageMessage(values, np.eye(4), timestamp=2.5, device_name="Probe").pack()
    damaged = packet[:-1] + bytes([packet[-1] ^ 1])
    with server:
        server.sendall(damaged + packet + message(matrix=pose(1, 2, 3), time_s=1.0).pack())
        assert source.sample().source == "stylus"
        header, body = images.get(timeout=DEADLINE_S)
        with pytest.raises(IgtlChecksumError):
            read_image(header, body)
        found = read_image(*images.get(timeout=DEADLINE_S)).image
    assert found.stamp == Stamp(2_500_000_000)
    np.testing.assert_array_equal(found.pixels, values[0])
