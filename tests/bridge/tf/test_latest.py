"""Latest poses of several frames."""

import threading

import numpy as np
import pytest

from app.bridge.tf import TfLookupError, TransformBuffer
from app.bridge.tf.latest import LatestPoses

DEADLINE_S = 60.0
FRAMES = ("left", "right")


@pytest.fixture
def buffer():
    return TransformBuffer()


@pytest.fixture
def latest(buffer):
    return LatestPoses(buffer, "world", FRAMES)


def move(buffer, stamp_ns, x_mm, frames=FRAMES, *, static=False):
    for index, frame in enumerate(frames):
        pose = (x_mm, 10.0 * index, 0.0, 0.0, 0.0, 0.0, 1.0)
        buffer.insert("world", frame, stamp_ns, pose, static=static)


def test_take_returns_the_newest_poses_and_counts_the_rest(buffer, latest):
    for number in range(1, 6):
        move(buffer, number, float(number))
        latest.received()
    poses = latest.take(0.0)
    assert (poses.root, poses.frames, poses.stamp_ns) == ("world", FRAMES, 5)
    assert np.array_equal(poses.matrices[:, :3, 3], [[5.0, 0.0, 0.0], [5.0, 10.0, 0.0]])
    assert latest.superseded == 4
    assert latest.take(0.0) is None


def test_messages_about_other_frames_give_no_poses(buffer, latest):
    move(buffer, 1, 0.0)
    latest.received()
    assert latest.take(0.0) is not None
    move(buffer, 2, 0.0, ["another"])
    latest.received()
    assert latest.take(0.0) is None
    move(buffer, 2, 0.0, ["left"])  # the common stamp is still the first one
    latest.received()
    assert latest.take(0.0) is None
    move(buffer, 2, 0.0, ["right"])
    latest.received()
    assert latest.take(0.0).stamp_ns == 2


def test_missing_names_the_frame_until_it_has_a_pose(buffer, latest):
    move(buffer, 1, 0.0, ["left"])
    latest.received()
    assert latest.take(0.0) is None
    assert "'right'" in latest.missing
    move(buffer, 1, 0.0)
    latest.received()
    assert latest.take(0.0) is not None
    assert latest.missing == ""


def test_restarted_source_is_followed(buffer, latest):
    move(buffer, 10_000_000_000, 1.0)
    latest.received()
    assert latest.take(0.0).stamp_ns == 10_000_000_000
    move(buffer, 5, 2.0)
    latest.received()
    assert latest.take(0.0).stamp_ns == 5


def test_repeated_static_edges_are_returned_again(buffer, latest):
    for x_mm in (1.0, 2.0):
        move(buffer, 0, x_mm, static=True)
        latest.received()
        poses = latest.take(0.0)
        assert poses.stamp_ns is None
        assert poses.matrices[0, 0, 3] == x_mm


def test_messages_about_other_frames_do_not_extend_the_timeout(buffer, latest, monkeypatch):
    lookups = []

    def lookup(*_):
        lookups.append(1)
        assert len(lookups) < 1000, "take does not return"
        latest.received()  # the next message arrives before this lookup returns
        raise TfLookupError("unknown")

    monkeypatch.setattr(buffer, "poses", lookup)
    latest.received()
    assert latest.take(0.0) is None
    assert lookups == [1]


def test_waiting_reader_is_woken(buffer, latest):
    taken = []

    def read():
        while len(taken) < 50:
            taken.append(latest.take(DEADLINE_S))
            read_once.release()

    read_once = threading.Semaphore(0)
    thread = threading.Thread(target=read)
    thread.start()
    for number in range(1, 51):
        move(buffer, number, float(number))
        latest.received()
        assert read_once.acquire(timeout=DEADLINE_S)
    thread.join(DEADLINE_S)
    assert [poses.stamp_ns for poses in taken] == list(range(1, 51))
